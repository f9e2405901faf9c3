"""The calibration procedures on the virtual bench: what they state holds the simulator's truth in its own interval."""

import csv
import json
from functools import cache
from math import log, pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.run import RunRequest, prepare, run
from simulated_hw.physics.gyro_parameters import NoiseParameters
from simulated_hw.physics.noise import ROWS_PER_CHUNK, SlowNoise
from simulated_hw.physics.streams import Stream
from tests.bench.campaigns import ROOT

pytestmark = pytest.mark.campaign

NAV, HIGH = "NAV-1", "HIGH-1"
EARTH_DPH = 15.041067 * sin(40.0 * pi / 180.0)


class Campaign:
    """A run of one of the procedures, and the truth its simulators kept for themselves."""

    def __init__(self, folder: Path, procedure: str) -> None:
        bench = ROOT / "benches" / "virtual_metrics.yaml"
        request = RunRequest(ROOT / "procedures" / f"{procedure}.yaml", bench, folder, procedure, None, ())
        self.end = run(prepare(request))
        self.documents: dict[str, Any] = json.loads((self.end.folder / "analyses" / "calibration.json").read_text())
        truth = folder / ".truth" / procedure
        self.hidden: dict[str, Any] = json.loads((truth / "truth.json").read_text())
        with (truth / "truth.csv").open() as file:
            rows = list(csv.DictReader(file))
        self.truth = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}

    def figures(self, dut: str, symbol: str) -> list[dict[str, Any]]:
        found = [one for one in self.documents[dut]["figures"] if one["symbol"] == symbol]
        assert found, f"{symbol} of {dut} is not stated"
        return found

    def figure(self, dut: str, symbol: str) -> dict[str, Any]:
        return self.figures(dut, symbol)[0]

    def parameters(self, dut: str) -> dict[str, Any]:
        found: dict[str, Any] = self.hidden["duts"][dut]["parameters"]
        return found

    def slow_dph(self, dut: str, begin_s: float, end_s: float) -> float:
        """What flicker and random walk have come to by then, since the beginning of the run; no white noise.

        A record cannot tell this from bias, and does not need to: it is bias, of this gyro in this hour.
        """
        p = self.parameters(dut)
        noise = NoiseParameters(**p["noise"])
        row_s = 1.0 / (1.0 + 1e-6 * p["clock_offset_ppm"])
        slow = SlowNoise(noise, row_s, Stream(self.hidden["seed"], dut, "slow noise"))
        first, last = int(begin_s / row_s), int(end_s / row_s)
        chunks = range(last // ROWS_PER_CHUNK + 1)
        return float(np.concatenate([slow.means_dps(k) for k in chunks])[first:last].mean()) * 3600.0

    def turn_on_scale_ppm(self, dut: str, cycle: int) -> float:
        """Scale-factor error of one power-on, which the truth log leaves out."""
        draw = Stream(self.hidden["seed"], dut, "turn-on").chunk(cycle).standard_normal(2)[1]
        return float(draw) * float(self.parameters(dut)["turn_on_scale_sigma_ppm"])

    def bias_dph(self, dut: str, begin_s: float, end_s: float) -> float:
        """True bias between two times: curve, turn-on, excursion, and what slow noise has come to."""
        inside = (self.truth["t_s"] >= begin_s) & (self.truth["t_s"] <= end_s)
        curve = polynomial(self.parameters(dut)["curves"]["bias_polynomial"], self.truth[f"coil_degc:{dut}"][inside])
        turn_on = self.truth[f"turn_on_bias_dph:{dut}"][inside]
        drawn = float(np.mean(curve + turn_on + self.truth[f"bias_dph:{dut}"][inside]))
        return drawn + self.slow_dph(dut, begin_s, end_s)

    def scale(self, dut: str, begin_s: float, end_s: float) -> float:
        """What K should be without nonlinearity: curve, excursion, first turn-on, and the table's hidden gain.

        The table turns by its gain too fast and cannot see it, so the K that it gives is larger by exactly that.
        """
        inside = (self.truth["t_s"] >= begin_s) & (self.truth["t_s"] <= end_s)
        p = self.parameters(dut)
        curve = polynomial(p["curves"]["scale_polynomial"], self.truth[f"coil_degc:{dut}"][inside])
        ppm = np.mean(curve + self.truth[f"scale_ppm:{dut}"][inside])
        return 1.0 + 1e-6 * (float(ppm) + self.turn_on_scale_ppm(dut, 0) + self.hidden["rate_table"]["rate_gain_ppm"])


def polynomial(coefficients: list[float], degc: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(sum(c * (degc - 25.0) ** k for k, c in enumerate(coefficients)))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("campaigns")
    return cache(lambda procedure: Campaign(folder, procedure))


def holds(figure: dict[str, Any], truth: float) -> bool:
    return bool(figure["low"] <= truth <= figure["high"])


@pytest.mark.parametrize("dut", [NAV, HIGH])
def test_static(made: Any, dut: str) -> None:
    one: Campaign = made("static")
    assert one.end.outcome == "PASS", one.end.message
    noise = one.parameters(dut)["noise"]
    series = next(about for about in one.end.manifest["series"] if about["dut"] == dut)
    assert holds(one.figure(dut, "B0"), one.bias_dph(dut, series["started_at_s"] + 3600.0, series["ended_at_s"]))
    assert holds(one.figure(dut, "N"), noise["arw_deg_sqrt_h"])
    assert one.figure(dut, "N")["u"] < 0.01 * noise["arw_deg_sqrt_h"]
    assert holds(one.figure(dut, "B"), noise["bias_instability_dph"])
    assert holds(one.figure(dut, "Qn"), noise["lsb_arcsec"] / sqrt(12.0))
    assert one.figure(dut, "Krw")["high"] > noise["rrw_dph_sqrt_h"] and one.figure(dut, "R")["low"] == 0.0


def test_static_never_says_one_stability_for_another(made: Any) -> None:
    one: Campaign = made("static")
    n, b = (one.parameters(NAV)["noise"][key] for key in ("arw_deg_sqrt_h", "bias_instability_dph"))
    assert holds(one.figure(NAV, "Bs(1 s)"), sqrt((60.0 * n) ** 2 + 2.0 * log(2.0) / pi * b**2))
    assert one.figure(NAV, "Bs(100 s)")["value"] > 6.0 * n
    minimum, fitted, stability = (one.figure(NAV, key)["value"] for key in ("sigma_min", "B", "Bs(100 s)"))
    assert minimum < fitted < stability
    assert one.figure(NAV, "Bs(100 s) detrended")["value"] < stability


@pytest.mark.parametrize("dut", [NAV, HIGH])
def test_scale_factor(made: Any, dut: str) -> None:
    one: Campaign = made("scale_factor")
    assert one.end.outcome == "PASS", one.end.message
    rows = list(csv.DictReader((one.end.folder / "points.csv").open()))
    spans = [
        (float(mine[0]["started_at_s"]), float(mine[-1]["ended_at_s"]))
        for dwell in sorted({int(row["dwell"]) for row in rows})
        if (mine := [row for row in rows if row["dut"] == dut and int(row["dwell"]) == dwell])
    ]
    true = [one.scale(dut, *span) for span in spans]
    stated = one.figures(dut, "K")
    assert len(stated) == len(true) == 5
    table_ppm = one.documents[dut]["conditions"]["half_widths"]["table_ppm"] / sqrt(3.0)
    for figure, k in zip(stated, true, strict=True):
        u_noise = sqrt(figure["u"] ** 2 - (1e-6 * table_ppm * figure["value"]) ** 2)
        assert abs(figure["value"] - k * line_of(one.parameters(dut), figure)[0]) < 3.0 * u_noise
    p = one.parameters(dut)
    for figure in one.figures(dut, "Ka"):
        assert figure["value"] == pytest.approx(2.0 * p["curves"]["asymmetry_ppm"], abs=2.0)
    for figure in one.figures(dut, "Kn"):
        assert figure["value"] == pytest.approx(line_of(p, figure)[1], abs=2.0)
    # Table and turn-on are common to all temperatures: the sensitivity is that of the realised scale factors.
    coils = [float(np.mean(one.truth[f"coil_degc:{dut}"][inside(one, span)])) for span in spans]
    slopes = [
        1e6 * (k - true[0]) / (t - coils[0]) for k, t in zip(true, coils, strict=True) if abs(t - coils[0]) > 10.0
    ]
    assert holds(one.figure(dut, "Kt"), max(map(abs, slopes)))


def inside(one: Campaign, span: tuple[float, float]) -> NDArray[np.bool_]:
    return np.asarray((one.truth["t_s"] >= span[0]) & (one.truth["t_s"] <= span[1]))


def line_of(p: dict[str, Any], figure: dict[str, Any]) -> tuple[float, float]:
    """Slope of a straight line through the response w (1 + k3 (w/max)^2 + a sign w), and what it leaves, in ppm."""
    w = np.array(figure["conditions"]["rates_dps"])
    k3, a = (1e-6 * p["curves"][key] for key in ("k3_ppm", "asymmetry_ppm"))
    f = w * (1.0 + k3 * (w / p["max_rate_dps"]) ** 2 + a * np.sign(w))
    line = np.polyfit(w, f, 1)
    return float(line[0]), float(1e6 * np.abs(f - np.polyval(line, w)).max() / np.abs(f).max())


@pytest.mark.parametrize("dut", [NAV, HIGH])
def test_temperature(made: Any, dut: str) -> None:
    one: Campaign = made("temperature_ramps")
    assert one.end.outcome == "PASS", one.end.message
    soaks = [about for about in one.end.manifest["series"] if about["dut"] == dut and about["label"].startswith("soak")]
    spans = [(about["started_at_s"], about["ended_at_s"]) for about in soaks]
    true = [one.bias_dph(dut, *span) for span in spans]
    assert all(holds(figure, bias) for figure, bias in zip(one.figures(dut, "B0"), true, strict=True))
    coils = [float(np.mean(one.truth[f"coil_degc:{dut}"][inside(one, span)])) for span in spans]
    steepest = max(
        abs(bias - true[0]) / abs(t - coils[0]) for bias, t in zip(true, coils, strict=True) if abs(t - coils[0]) > 10.0
    )
    bt = one.figure(dut, "Bt")
    assert bt["value"] == pytest.approx(steepest, abs=4.0 * bt["u"])
    thermal = one.parameters(dut)["thermal"]
    # A steady ramp: the inner coil lags the outer one by its time constant.
    per_slope = thermal["shupe_c1"] + thermal["shupe_c3"] * thermal["coil_inner_s"] / 60.0
    for figure in one.figures(dut, "B_dT"):
        assert holds(figure, per_slope) and figure["value"] == pytest.approx(per_slope, rel=0.1)
    fast, slow = one.figures(dut, "B_hys")
    assert fast["value"] == pytest.approx(2.0 * per_slope, rel=0.05)
    assert slow["value"] == pytest.approx(per_slope, rel=0.05)
    assert one.figure(dut, "BsT(100 s)")["value"] > 0.4 * per_slope


@pytest.mark.parametrize("dut", [NAV, HIGH])
def test_power_cycles(made: Any, dut: str) -> None:
    one: Campaign = made("power_cycles")
    assert one.end.outcome == "PASS", one.end.message
    p = one.parameters(dut)
    br = one.figure(dut, "Br")
    assert br["conditions"]["between"] == "power_off" and br["conditions"]["repeats"] == br["n"] == 7
    noise = br["conditions"]["of_which_noise_of_one_dph"]
    assert holds(br, sqrt(p["turn_on_bias_sigma_dph"] ** 2 + noise**2))
    kr = one.figure(dut, "Kr")
    assert kr["n"] == 7 and holds(kr, p["turn_on_scale_sigma_ppm"])
    starts = [about for about in one.end.manifest["series"] if about["dut"] == dut]
    for figure, about in zip(one.figures(dut, "B0"), starts, strict=True):
        assert holds(figure, one.bias_dph(dut, about["started_at_s"] + 9000.0, about["ended_at_s"]))
    # The coil warms by 3 K within the time constants of its housing.
    assert 300.0 < one.figure(dut, "t_on")["value"] < 3600.0


def test_threshold(made: Any) -> None:
    one: Campaign = made("threshold")
    assert one.end.outcome == "PASS", one.end.message
    band = one.parameters(HIGH)["curves"]["dead_band_dph"]
    # Beyond the band w - exp(1 - w) of w comes out: half of it at 1.371 bands. The bias shifts it by its own size.
    half, offset = 1.371 * band, one.bias_dph(HIGH, 10800.0, 40000.0)
    found = one.figure(HIGH, "W_th")
    assert found["low"] - abs(offset) <= half <= found["high"] + abs(offset)
    zone = one.figure(HIGH, "W_dz")
    assert zone["low"] <= 2.0 * half <= zone["high"]
    for dut, symbol in ((NAV, "W_th"), (NAV, "W_res"), (HIGH, "W_res")):
        assert one.figure(dut, symbol)["value"] == pytest.approx(0.25, abs=1e-4)
    assert f"around an input of {EARTH_DPH:.6g} deg/h" in one.figure(NAV, "W_res")["definition"]
