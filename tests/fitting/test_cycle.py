"""Reduction and figures of a cycle, against values counted by hand and simulation."""

import numpy as np
import pytest

from fitting.cycle import (
    bias_stability,
    block_means,
    block_rows,
    figures,
    first_dwell,
    improvement_percent,
    reduce_cycle,
)


def test_blocks_drop_what_is_left_over() -> None:
    assert block_means(np.arange(11.0), 3).tolist() == [1.0, 4.0, 7.0]
    assert block_means(np.arange(10.0).reshape(5, 2), 2).tolist() == [[1.0, 2.0], [5.0, 6.0]]
    with pytest.raises(ValueError, match="less than one block"):
        block_means(np.arange(3.0), 4)


def test_published_reductions_have_their_number_of_rows() -> None:
    """reference_experiments.md: 49 800 rows at 1 Hz are 498; 9.33 h at 100 Hz in blocks of 10 000 are 336 rows."""
    assert len(block_means(np.zeros(49_800), block_rows(100.0, 1.0))) == 498
    assert block_rows(100.0, 0.01) == 10_000
    assert int(9.34 * 3600.0 * 100.0) // block_rows(100.0, 0.01) == 336
    assert block_rows(100.0, 1.0 / 3.0) == 300


@pytest.mark.parametrize(("averaging", "period"), [(100.0, 0.3), (1.0, 100.0), (100.0, 0.0), (100.0, float("nan"))])
def test_blocks_are_whole_numbers_of_samples(averaging: float, period: float) -> None:
    with pytest.raises(ValueError, match="whole number of samples"):
        block_rows(averaging, period)


def test_first_dwell_is_what_is_settled_before_the_first_ramp() -> None:
    warming = 25.0 - 5.0 * np.exp(-np.arange(60) / 6.0)
    temperature = np.concatenate([warming, 25.0 - np.arange(1.0, 30.0), np.full(60, -4.0)])
    dwell = first_dwell(temperature, 100.0)
    assert dwell.stop in (60, 61) and dwell.start > 20
    assert np.ptp(temperature[dwell.start - 6 : dwell.stop - 1]) < 0.3
    slope = (temperature[dwell] - temperature[dwell.start - 6 : dwell.stop - 6]) / 10.0
    assert np.abs(slope).max() <= 0.01


def test_a_temperature_that_never_settles_is_said() -> None:
    with pytest.raises(ValueError, match="never settles"):
        first_dwell(np.arange(50.0), 100.0)
    with pytest.raises(ValueError, match="too few"):
        first_dwell(np.zeros(6), 100.0)


def test_reduce_cycle_takes_the_truth_from_the_first_dwell() -> None:
    rng = np.random.default_rng(0)
    temperature = np.concatenate([np.full(5000, 25.0), 25.0 - 0.01 * np.arange(3000), np.full(2050, -5.0)])
    output = 9.67 + 1e-3 * (temperature - 25.0) + 0.5 * rng.standard_normal(len(temperature))
    cycle = reduce_cycle(output, temperature[:, np.newaxis], 1.0)
    assert cycle.output_dph.shape == (100,) and cycle.temperatures_degc.shape == (100, 1)
    assert cycle.dwell == slice(6, 50)
    assert cycle.truth_dph == pytest.approx(output[600:5000].mean())
    assert cycle.truth_u_dph == pytest.approx(0.05 / np.sqrt(44), rel=0.4)
    assert cycle.error_dph == pytest.approx(block_means(output, 100) - cycle.truth_dph)
    assert cycle.centred_dph.mean() == pytest.approx(0.0, abs=1e-12)


def test_what_cannot_be_reduced_is_refused() -> None:
    with pytest.raises(ValueError, match="shape"):
        reduce_cycle(np.zeros(500), np.zeros(500), 1.0)
    with pytest.raises(ValueError, match="NaN"):
        reduce_cycle(np.full(500, np.nan), np.zeros((500, 1)), 1.0)


def test_bias_stability_is_the_std_of_block_means_with_n_minus_1() -> None:
    stability = bias_stability(np.array([1.0, 3.0, 2.0, 2.0, 0.0, 2.0, 9.0]), 50.0)
    assert stability.blocks == 3 and stability.value_dph == pytest.approx(np.std([2.0, 2.0, 1.0], ddof=1))


def test_bias_stability_of_white_noise_is_six_times_the_random_walk() -> None:
    """gyro_test_metrics.md, section 3: Bs(100 s) = 6 N for N in deg/sqrt(h); and section 4, the interval for Q = 6."""
    n = 0.005
    values = 60.0 * n * np.random.default_rng(1).standard_normal(400_000)
    assert bias_stability(values, 1.0).value_dph == pytest.approx(6.0 * n, rel=0.05)
    six = bias_stability(np.arange(6.0), 100.0)
    assert six.low_dph / six.value_dph == pytest.approx(0.62, abs=0.005)
    assert six.high_dph / six.value_dph == pytest.approx(2.45, abs=0.005)
    with pytest.raises(ValueError, match="two or more"):
        bias_stability(np.zeros(3), 50.0)


def test_figures_of_residuals() -> None:
    found = figures(np.array([1.0, -1.0, 2.0, 0.0]), 100.0)
    assert (found.rows, found.mean_dph, found.mae_dph, found.mse_dph2) == (4, 0.5, 1.0, 1.5)
    assert improvement_percent(0.09, 0.027) == pytest.approx(70.0)
    with pytest.raises(ValueError, match="no meaning"):
        improvement_percent(0.0, 1.0)
