"""Frames to samples to a point, against slow loops, numpy's own fits, and the noise they are meant for."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import linregress

from bench.reduction import (
    OUTLIER_MADS,
    Samples,
    held_frames,
    outliers,
    point_statistics,
    slope,
    slope_uncertainty,
    spikes,
    standard_uncertainty,
    to_samples,
)

Floats = NDArray[np.float64]


def slow_samples(
    offset: NDArray[np.int64],
    rate: Floats,
    temperature: Floats,
    good: NDArray[np.bool_],
    per_sample: float,
    count: int,
    newest: bool,
) -> tuple[list[float], list[float], list[int]]:
    """The definition, frame by frame: a frame belongs to the interval its middle lies in."""
    rates: list[float] = []
    temperatures: list[float] = []
    frames: list[int] = []
    for interval in range(count):
        mine = [
            k for k in range(len(offset)) if good[k] and interval <= (int(offset[k]) + 0.5) / per_sample < interval + 1
        ]
        used = mine[-1:] if newest else mine
        rates.append(sum(rate[k] for k in used) / len(used) if used else math.nan)
        temperatures.append(sum(temperature[k] for k in used) / len(used) if used else math.nan)
        frames.append(len(used))
    return rates, temperatures, frames


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    per_sample=st.one_of(
        st.integers(1, 12).map(float), st.sampled_from([2.5, 1.0, 100 / 3, 7.2, 0.29 * 100]), st.floats(1.0, 30.0)
    ),
    count=st.integers(1, 12),
    lost=st.sampled_from([0.0, 0.05, 0.5, 0.95, 1.0]),
    bad=st.sampled_from([0.0, 0.1, 1.0]),
    newest=st.booleans(),
)
def test_samples_are_those_of_a_slow_loop(
    seed: int, per_sample: float, count: int, lost: float, bad: float, newest: bool
) -> None:
    rng = np.random.default_rng(seed)
    offset = np.flatnonzero(rng.random(math.ceil(count * per_sample) + 3) >= lost).astype(np.int64)
    if lost == 0.0 and seed % 2:
        offset = offset[: math.ceil(count * per_sample)]
    rate, temperature = rng.normal(size=(2, len(offset)))
    good = rng.random(len(offset)) >= bad
    samples = to_samples(offset, rate, temperature, good, per_sample, count, newest)
    rates, temperatures, frames = slow_samples(offset, rate, temperature, good, per_sample, count, newest)
    np.testing.assert_allclose(samples.rate_dps, rates, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(samples.temperature_degc, temperatures, rtol=1e-12, atol=1e-14)
    assert samples.frames.tolist() == frames


@pytest.mark.parametrize("newest", [False, True])
def test_a_complete_record_and_one_with_a_bad_frame_more_agree(newest: bool) -> None:
    """The quick path for records without losses gives what the general one gives."""
    rng = np.random.default_rng(1)
    offset = np.arange(600, dtype=np.int64)
    rate, temperature = rng.normal(size=(2, 600))
    good = np.ones(600, bool)
    quick = to_samples(offset, rate, temperature, good, 60.0, 10, newest)
    longer = [np.append(values, values[-1]) for values in (rate, temperature)]
    slow = to_samples(np.append(offset, 600), *longer, np.append(good, False), 60.0, 10, newest)
    np.testing.assert_allclose(quick.rate_dps, slow.rate_dps, rtol=1e-13)
    np.testing.assert_allclose(quick.temperature_degc, slow.temperature_degc, rtol=1e-13)
    assert quick.frames.tolist() == slow.frames.tolist() == [1 if newest else 60] * 10


def test_no_frames_at_all() -> None:
    none = np.empty(0)
    samples = to_samples(np.empty(0, np.int64), none, none, np.empty(0, bool), 60.0, 4)
    assert np.isnan(samples.rate_dps).all()
    assert samples.frames.tolist() == [0, 0, 0, 0]
    assert point_statistics(samples, 0.6) is None


def test_a_shifted_record_loses_only_its_missing_end() -> None:
    """Frames are placed by their index, so a late start empties intervals and moves no frame."""
    offset = np.arange(20, 40, dtype=np.int64)
    samples = to_samples(offset, offset.astype(float), np.zeros(20), np.ones(20, bool), 10.0, 4)
    np.testing.assert_array_equal(samples.rate_dps, [np.nan, np.nan, 24.5, 34.5])
    assert samples.frames.tolist() == [0, 0, 10, 10]


def made(rate: Floats, temperature: Floats | None = None) -> Samples:
    n = len(rate)
    return Samples(rate, np.full(n, 25.0) if temperature is None else temperature, np.ones(n, np.int64))


class TestOutliers:
    @pytest.mark.parametrize("level", [0.0, -180.0, 1e6])
    @pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3])
    def test_the_rule_is_six_scaled_mads_from_the_median(self, level: float, scale: float) -> None:
        base = np.arange(-50.0, 51.0)  # median 0, median absolute deviation 25
        edge = OUTLIER_MADS * 1.4826 * 25
        for factor, expected in ((0.999, False), (1.001, True), (-0.999, False), (-1.001, True)):
            # One value on each side, so that the median stays where it is.
            values = np.concatenate([base, [factor * edge, -math.copysign(60.0, factor)]])
            mad = float(np.median(np.abs(values - np.median(values))))
            values[-2] = factor * OUTLIER_MADS * 1.4826 * mad
            found = outliers(level + scale * values)
            assert found[:-2].sum() == 0
            assert bool(found[-2]) is expected
        assert OUTLIER_MADS == 6.0

    def test_white_noise_hardly_ever_loses_a_sample(self) -> None:
        values = np.random.default_rng(3).normal(size=(400, 1000))
        assert sum(int(outliers(row).sum()) for row in values) <= 1

    def test_spikes_are_found_and_counted_and_do_not_move_the_mean(self) -> None:
        rng = np.random.default_rng(4)
        values = rng.normal(10.0, 0.01, 1000)
        spiked = values.copy()
        hit = rng.choice(1000, 37, replace=False)
        spiked[hit] += rng.choice([-5.0, 5.0], 37)
        statistics = point_statistics(made(spiked), 0.6)
        assert statistics is not None
        assert (statistics.samples, statistics.outliers) == (963, 37)
        clean = np.delete(values, hit)
        assert statistics.rate_mean_dps == pytest.approx(clean.mean(), rel=1e-14)
        assert statistics.rate_std_dps == pytest.approx(clean.std(ddof=1), rel=1e-12)

    def test_coarse_counts_are_not_outliers(self) -> None:
        """More than half of the readings on one count: their MAD is zero and the rule says nothing."""
        values = np.array([5.0] * 60 + [6.0] * 20 + [4.0] * 20)
        assert not outliers(values).any()


class TestUncertainty:
    """A standard uncertainty is honest if mean ± u holds the truth as often as a normal error does: 68.3 %."""

    RECORDS, LENGTH = 1500, 1000

    def coverage(self, records: Floats, k: float = 1.0) -> float:
        u = np.array([standard_uncertainty(row) for row in records])
        return float(np.mean(np.abs(records.mean(axis=1)) <= k * u))

    def test_white_noise(self) -> None:
        """Batch means may only widen the white figure: at least 68.3 %, and not much more. 1500 records: ± 1.2 %."""
        records = np.random.default_rng(5).normal(size=(self.RECORDS, self.LENGTH))
        assert 0.67 < self.coverage(records) < 0.77
        assert 0.945 < self.coverage(records, 2.0) < 0.985
        u = np.array([standard_uncertainty(row) for row in records])
        assert 1.0 <= float(np.mean(u)) * math.sqrt(self.LENGTH) < 1.15

    @pytest.mark.parametrize(("phi", "least"), [(0.5, 0.66), (0.8, 0.64), (0.95, 0.5)])
    def test_correlated_noise(self, phi: float, least: float) -> None:
        """First-order autoregressive noise, correlated over 2/(1-phi) samples: 4, 10 and 40 of batches of 32.

        A batch much longer than the correlation is enough; one shorter (phi 0.95) still catches most of it, where
        s/√n would claim 12 %.
        """
        rng = np.random.default_rng(6)
        white = rng.normal(size=(self.RECORDS, self.LENGTH + 500))
        records = lfilter([1.0], [1.0, -phi], white, axis=1)[:, 500:]
        covered = self.coverage(records)
        assert least < covered < 0.75
        naive = records.std(axis=1, ddof=1) / math.sqrt(self.LENGTH)
        assert covered > float(np.mean(np.abs(records.mean(axis=1)) <= naive)) + 0.1

    def test_a_drift_is_not_hidden_by_many_samples(self) -> None:
        """A ramp of 1 over the record: batch means of a ramp have the ramp's own spread, √(1/12)."""
        ramp = np.linspace(0.0, 1.0, 1024)
        assert standard_uncertainty(ramp) == pytest.approx(math.sqrt(1 / 12) / math.sqrt(32), rel=0.05)

    def test_it_is_never_below_the_white_figure(self) -> None:
        alternating = np.tile([-1.0, 1.0], 500)
        assert standard_uncertainty(alternating) == pytest.approx(1 / math.sqrt(1000), rel=1e-3)

    @pytest.mark.parametrize("n", [2, 3, 10, 15])
    def test_few_values_have_the_white_figure(self, n: int) -> None:
        values = np.random.default_rng(n).normal(size=n)
        assert standard_uncertainty(values) == pytest.approx(values.std(ddof=1) / math.sqrt(n), rel=1e-12)

    @pytest.mark.parametrize("n", [0, 1])
    def test_of_less_than_two_values_nothing_is_known(self, n: int) -> None:
        assert math.isnan(standard_uncertainty(np.ones(n)))

    def test_it_scales_with_the_unit_and_not_with_the_level(self) -> None:
        values = np.random.default_rng(8).normal(size=1000)
        u = standard_uncertainty(values)
        assert standard_uncertainty(values * 3600.0) == pytest.approx(3600.0 * u, rel=1e-12)
        assert standard_uncertainty(values + 180.0) == pytest.approx(u, rel=1e-9)


class TestSlope:
    @given(st.integers(0, 2**32), st.integers(2, 200))
    def test_it_is_that_of_polyfit(self, seed: int, n: int) -> None:
        rng = np.random.default_rng(seed)
        times = np.cumsum(rng.uniform(0.01, 10.0, n)) + rng.uniform(0, 1e4)
        values = rng.normal(size=n) + rng.normal() * (times - times[0])
        expected = float(np.polyfit(times - times.mean(), values, 1)[0])
        assert slope(times, values) == pytest.approx(expected, rel=1e-6, abs=1e-9)

    def test_of_less_than_two_instants_it_is_zero(self) -> None:
        assert slope(np.array([1.0]), np.array([5.0])) == 0.0
        assert slope(np.empty(0), np.empty(0)) == 0.0
        assert slope(np.array([1.0, 1.0]), np.array([5.0, 6.0])) == 0.0


class TestSlopeUncertainty:
    @given(st.integers(0, 2**32), st.integers(3, 200))
    def test_it_is_the_standard_error_of_linear_regression_widened_by_the_correlation(self, seed: int, n: int) -> None:
        rng = np.random.default_rng(seed)
        times = np.cumsum(rng.uniform(0.01, 1.0, n)) + 100.0
        values = 0.1 * times + rng.normal(size=n)
        line = linregress(times, values)
        residual = values - line.intercept - line.slope * times
        lag_one = sum(a * b for a, b in pairwise(residual)) / sum(a * a for a in residual)
        r = min(max(lag_one, 0.0), 0.99)
        expected = line.stderr * math.sqrt((1 + r) / (1 - r))
        assert slope_uncertainty(times, values) == pytest.approx(expected, rel=1e-6)

    @pytest.mark.parametrize("held", [1, 5, 20])
    def test_it_is_the_scatter_of_slopes_even_of_a_sensor_that_holds_its_readings(self, held: int) -> None:
        """500 records of 400 samples: the slopes scatter no more than u says, and not much less."""
        rng = np.random.default_rng(held)
        times = np.arange(400.0)
        records = np.repeat(rng.normal(size=(500, 400 // held)), held, axis=1)
        scatter = float(np.std([slope(times, row) for row in records]))
        claimed = float(np.mean([slope_uncertainty(times, row) for row in records]))
        assert 0.9 < claimed / scatter < 1.7

    def test_of_less_than_three_instants_nothing_is_known(self) -> None:
        assert slope_uncertainty(np.array([1.0, 2.0]), np.array([1.0, 5.0])) == math.inf
        assert slope_uncertainty(np.ones(5), np.arange(5.0)) == math.inf

    def test_of_a_reading_that_never_moves_all_is_known(self) -> None:
        assert slope_uncertainty(np.arange(5.0), np.full(5, 25.0)) == 0.0


class TestPoint:
    def test_figures_of_a_small_point_by_hand(self) -> None:
        rate = np.array([1.0, 2.0, np.nan, 3.0, 4.0])
        temperature = np.array([20.0, 20.1, np.nan, 20.3, 20.4])
        statistics = point_statistics(Samples(rate, temperature, np.array([1, 1, 0, 1, 1])), every_s=30.0)
        assert statistics is not None
        assert statistics.rate_mean_dps == 2.5
        assert statistics.rate_std_dps == pytest.approx(math.sqrt(5 / 3), rel=1e-14)
        assert statistics.rate_mean_u_dps == pytest.approx(math.sqrt(5 / 3) / 2, rel=1e-14)
        assert (statistics.samples, statistics.outliers) == (4, 0)
        assert statistics.dut_temperature_degc == pytest.approx(20.2, rel=1e-14)
        # 0.1 K every 30 s, the missing sample's instant kept free.
        assert statistics.dut_temperature_slope_degc_min == pytest.approx(0.2, rel=1e-12)

    def test_the_slope_of_a_slow_drift_among_noise(self) -> None:
        rng = np.random.default_rng(9)
        minutes = np.arange(1000) * 0.6 / 60
        temperature = 25.0 + 0.02 * minutes + rng.normal(0, 1e-3, 1000)
        statistics = point_statistics(made(rng.normal(size=1000), temperature), 0.6)
        assert statistics is not None
        # Standard error of the slope: 1e-3 K / (√1000 · 2.9 min).
        assert statistics.dut_temperature_slope_degc_min == pytest.approx(0.02, abs=5e-5)

    def test_one_sample_has_a_mean_and_no_spread(self) -> None:
        statistics = point_statistics(made(np.array([5.0])), 1.0)
        assert statistics is not None
        assert statistics.rate_mean_dps == 5.0
        assert math.isnan(statistics.rate_std_dps)
        assert math.isnan(statistics.rate_mean_u_dps)
        assert statistics.dut_temperature_slope_degc_min == 0.0

    def test_a_gyro_without_a_sensor_has_no_temperature(self) -> None:
        statistics = point_statistics(made(np.arange(10.0), np.full(10, np.nan)), 1.0)
        assert statistics is not None
        assert statistics.rate_mean_dps == 4.5
        assert math.isnan(statistics.dut_temperature_degc)


class TestSpikes:
    GOOD = np.ones(60_000, bool)

    def noise(self, seed: int, n: int = 60_000) -> Floats:
        return np.random.default_rng(seed).normal(10.0, 0.01, n)

    def test_white_noise_has_none(self) -> None:
        assert all(spikes(self.noise(seed), self.GOOD) is None for seed in range(40))

    @given(st.integers(0, 2**32), st.lists(st.integers(0, 4999), min_size=1, max_size=20, unique=True), st.booleans())
    @settings(max_examples=50)
    def test_single_frames_far_off_are_found_exactly(self, seed: int, hit: list[int], coarse: bool) -> None:
        """Not those with neighbours that are off as well for more than three in all; whatever is coarse or fine."""
        at = np.array([place for place in hit if not {place - 1, place + 1, place + 2, place - 2} & set(hit)], int)
        rate = np.rint(self.noise(seed, 5000) * 50) / 50 if coarse else self.noise(seed, 5000)
        rate[at] += np.random.default_rng(seed).choice([-1.0, 1.0], at.size)
        found = spikes(rate, self.GOOD[:5000])
        assert sorted(at) == ([] if found is None else list(np.flatnonzero(found)))

    def test_what_stays_off_is_motion_and_no_spike(self) -> None:
        rate = self.noise(1)
        rate[100:104] += 5.0
        assert spikes(rate, self.GOOD) is None
        rate[200:203] += 5.0
        found = spikes(rate, self.GOOD)
        assert found is not None and list(np.flatnonzero(found)) == [200, 201, 202]

    def test_frames_that_are_not_good_are_not_looked_at(self) -> None:
        rate, good = self.noise(2), self.GOOD.copy()
        rate[::1000], good[::1000] = np.nan, False
        assert spikes(rate, good) is None
        rate[1] = 99.0
        found = spikes(rate, good)
        assert found is not None and list(np.flatnonzero(found)) == [1]

    @pytest.mark.parametrize("n", [0, 1, 9])
    def test_of_a_few_frames_nothing_can_be_said(self, n: int) -> None:
        assert spikes(np.arange(n) ** 9.0, np.ones(n, bool)) is None

    def test_left_out_they_do_not_move_the_mean(self) -> None:
        """Spikes too small to make their sample an outlier: 30 sigma of a frame are 4 of a sample of 60."""
        clean = self.noise(3)
        rate, temperature = clean.copy(), np.zeros(clean.size)
        rate[::600] += 0.3
        offset = np.arange(clean.size)

        def mean(good: NDArray[np.bool_]) -> float:
            statistics = point_statistics(to_samples(offset, rate, temperature, good, 60.0, 1000), 0.6)
            assert statistics is not None
            return statistics.rate_mean_dps

        found = spikes(rate, self.GOOD)
        assert found is not None and found.sum() == 100
        biased, robust = mean(self.GOOD), mean(~found)
        u = 0.01 / math.sqrt(clean.size)
        assert biased - clean.mean() > 5 * u
        assert abs(robust - clean.mean()) < 0.2 * u


class TestHeldFrames:
    @pytest.mark.parametrize("n", [300, 10_000, 60_000])
    @pytest.mark.parametrize("sigma", [0.2, 0.3, 0.5, 1.0, 1e4])
    @pytest.mark.parametrize("mean", [0.0, 0.25, 0.5])
    def test_noise_of_any_resolution_is_no_frozen_output(self, n: int, sigma: float, mean: float) -> None:
        rng = np.random.default_rng(n)
        for _ in range(5):
            assert held_frames(np.rint(rng.normal(mean, sigma, n)).astype(np.int32)) == 0

    @given(st.integers(0, 2**32), st.integers(30, 5000), st.integers(0, 5000))
    @settings(max_examples=50)
    def test_a_stretch_of_equal_frames_is_counted(self, seed: int, length: int, begin: int) -> None:
        raw = np.random.default_rng(seed).normal(size=10_000)
        raw[begin : begin + length] = raw[begin]
        assert held_frames(raw) == length - 1

    def test_among_coarse_counts_it_is_found_as_well(self) -> None:
        raw = np.rint(np.random.default_rng(1).normal(0.2, 0.4, 60_000))
        raw[30_000:36_000] = raw[30_000]
        assert 5990 <= held_frames(raw) <= 6030

    def test_several_stretches_add_up(self) -> None:
        raw = np.random.default_rng(2).normal(size=60_000).astype(np.float32)
        for begin in range(0, 60_000, 10_000):
            raw[begin : begin + 5000] = raw[begin]
        assert held_frames(raw) == 6 * 4999

    def test_an_output_that_never_changes(self) -> None:
        assert held_frames(np.zeros(1000)) == 999
        assert held_frames(np.zeros(10)) == held_frames(np.zeros(0)) == held_frames(np.zeros(1)) == 0

    def test_an_output_that_moves_but_for_a_moment_is_frozen(self) -> None:
        raw = np.zeros(60_000)
        raw[[10, 30_000]] = 1.0
        assert held_frames(raw) == 60_000 - 1 - 4


def test_the_ripple_of_an_encoder_is_no_spike() -> None:
    """15 Hz at 100 Hz: every 20th frame meets it at the same phase, and so does every 120th of ten minutes."""
    rng = np.random.default_rng(5)
    t = np.arange(60_000) / 100.0
    for phase in np.linspace(0.0, 2.0 * np.pi, 12):
        rate = 150.0 + 0.026 * np.sin(2 * np.pi * 15.0 * t + phase) + 0.004 * rng.standard_normal(t.size)
        assert spikes(rate, np.ones(t.size, bool)) is None
        rate[[7, 30_000]] += 1.0
        found = spikes(rate, np.ones(t.size, bool))
        assert found is not None and np.flatnonzero(found).tolist() == [7, 30_000]
