"""`fogbench allan`: files of every kind give the same curve, gaps stay open, mistakes are told with what is allowed."""

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import allantools
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from bench.allan.read import factor_of, interval_of, read_file
from bench.cli.allan import command
from bench.errors import InvalidFiles, UserMistake
from tests.bench.campaigns import ROOT, run_campaign

RATE_DPH = np.random.default_rng(5).normal(9.0, 3.0, 20_000)
RECORD = """\
procedure: short
raw: samples
steps:
  - dwell: 10 min
  - record: {name: short, every: 1 s, steps: [{dwell: 10 min}]}
  - record: {name: still, every: 1 s, steps: [{dwell: 30 min}]}
"""


def ask(*arguments: object) -> Result:
    return CliRunner().invoke(command, [str(one) for one in arguments])


def found(*arguments: object) -> dict[str, Any]:
    done = ask(*arguments, "--json")
    assert done.exit_code == 0, done.output
    (one,) = json.loads(done.output)
    return dict(one)


def save(folder: Path) -> dict[str, Path]:
    """The same rates in every format."""
    files = {name: folder / f"rates.{name}" for name in ("npy", "txt", "csv", "parquet")}
    np.save(files["npy"], RATE_DPH)
    np.savetxt(files["txt"], RATE_DPH, fmt="%.17g", header="of a gyro")
    table = pd.DataFrame({"t_s": np.arange(len(RATE_DPH)) * 0.1, "gyro_rate": RATE_DPH, "temp": 25.0})
    table.to_csv(files["csv"], index=False)
    table.to_parquet(files["parquet"])
    return files


def test_every_format_gives_the_same_curve_as_an_independent_program(tmp_path: Path) -> None:
    files = save(tmp_path)
    curves = [found(path, "--every", "0.1 s")["curve"] for path in files.values()]
    curves.append(found(files["csv"])["curve"])  # the interval from its time column
    tau, deviation, _, _ = allantools.oadev(RATE_DPH, rate=10.0, data_type="freq", taus=np.array(curves[0]["tau_s"]))
    for curve in curves:
        assert curve["tau_s"] == pytest.approx(tau.tolist())
        assert curve["deviation_dph"] == pytest.approx(deviation.tolist(), rel=1e-9)


def test_white_noise_is_found_and_needless_terms_have_only_an_upper_limit(tmp_path: Path) -> None:
    path = save(tmp_path)["npy"]
    figures = {one["symbol"]: one for one in found(path, "--rate", 10)["figures"]}
    # 3 deg/h every 0.1 s: N = 3 sqrt(0.1) / 60 deg/sqrt(h).
    assert figures["N"]["low"] <= 3.0 * np.sqrt(0.1) / 60.0 <= figures["N"]["high"]
    printed = ask(path, "--rate", "10 Hz").output
    assert "rate ramp          below" in printed and "Allan minimum: " in printed
    (line,) = [one for one in printed.splitlines() if one.startswith("Allan minimum")]
    assert "not the bias instability B" in line


def test_the_unit_is_converted(tmp_path: Path) -> None:
    path = tmp_path / "dps.npy"
    np.save(path, RATE_DPH / 3600.0)
    plain, converted = found(save(tmp_path)["npy"], "--rate", 10), found(path, "--rate", 10, "--unit", "deg/s")
    assert converted["curve"]["deviation_dph"] == pytest.approx(plain["curve"]["deviation_dph"])
    assert factor_of("deg/min") == 60.0


def test_missing_samples_stay_missing_and_are_counted(tmp_path: Path) -> None:
    rate = RATE_DPH.copy()
    rate[5000:5100] = np.nan
    path = tmp_path / "gap.csv"
    path.write_text("rate\n" + "\n".join("" if np.isnan(one) else repr(float(one)) for one in rate) + "\n")
    path.write_text(path.read_text().replace("\n\n", "\nnan\n").replace("\n\n", "\nnan\n"))
    one = found(path, "--rate", 10)
    assert (one["samples"], one["missing"]) == (20_000, 100)
    assert "100 samples are missing" in ask(path, "--rate", 10).output


def test_the_plot_is_a_standalone_svg(tmp_path: Path) -> None:
    path = tmp_path / "out" / "allan.svg"
    done = ask(save(tmp_path)["npy"], "--rate", 10, "-o", path)
    assert done.exit_code == 0 and f"plot: {path}" in done.output
    assert ElementTree.parse(path).getroot().tag == "{http://www.w3.org/2000/svg}svg"
    assert "averaging time" in path.read_text()


def refused(*arguments: object) -> str:
    done = ask(*arguments)
    assert isinstance(done.exception, UserMistake | InvalidFiles), done.output
    return str(done.exception)


def test_mistakes_say_what_is_allowed(tmp_path: Path) -> None:
    files = save(tmp_path)
    assert "nothing says how often it was sampled. Give --rate" in refused(files["npy"])
    assert "no column 'rat' of numbers. Allowed: gyro_rate" in refused(files["csv"], "--column", "rat")
    assert "--unit 'dph' is no unit of rate. Allowed: deg/h" in refused(files["npy"], "--rate", 10, "--unit", "dph")
    assert "give one of them" in refused(files["npy"], "--rate", 10, "--every", 1)
    assert "give a name that ends in .svg" in refused(files["npy"], "--rate", 10, "-o", "a.png")
    assert "there is no such file" in refused(tmp_path / "no.csv", "--rate", 1)
    assert "--dut and --record are of a run" in refused(files["npy"], "--rate", 1, "--dut", "A")
    assert "--rate must be above 0" in refused(files["npy"], "--rate", 0)


def test_bad_files_are_refused_with_the_place(tmp_path: Path) -> None:
    stray = tmp_path / "stray.csv"
    stray.write_text("rate\n" + "1.5\n" * 20 + "1,5x\n".replace(",", ".") + "2.5\n" * 20)
    assert "row 21 of column 'rate' is '1.5x'" in refused(stray, "--rate", 1)
    short = tmp_path / "short.txt"
    short.write_text("1\n2\n3\n")
    assert "3 samples" in refused(short, "--rate", 1)
    constant = tmp_path / "constant.txt"
    constant.write_text("1\n" * 500)
    assert "the record is constant. Is the gyro's output frozen?" in refused(constant, "--rate", 1)
    (tmp_path / "empty.csv").write_text("")
    assert "the file is empty" in refused(tmp_path / "empty.csv", "--rate", 1)
    (tmp_path / "junk.npy").write_bytes(b"junk")
    assert "no file of numbers that numpy wrote" in refused(tmp_path / "junk.npy", "--rate", 1)
    (tmp_path / "junk.parquet").write_bytes(b"junk")
    assert "not a Parquet file" in refused(tmp_path / "junk.parquet", "--rate", 1)
    uneven = tmp_path / "uneven.csv"
    uneven.write_text("t_s,rate\n" + "\n".join(f"{k + (k == 7) * 0.5},{k % 3}" for k in range(50)) + "\n")
    assert "2 of 49 steps of column 't_s' are not the usual 1 s" in refused(uneven)


def test_columns_may_be_separated_by_blanks_and_have_no_names(tmp_path: Path) -> None:
    path = tmp_path / "two.txt"
    np.savetxt(path, np.column_stack([RATE_DPH[:50], -RATE_DPH[:50]]))
    assert read_file(path, "2", 0.1, "deg/h").rate_dph == pytest.approx(-RATE_DPH[:50])
    assert "Say which with --column: 1, 2" in refused(path, "--rate", 1)


def test_intervals() -> None:
    assert interval_of("1 kHz", None) == pytest.approx(1e-3) and interval_of(None, "10 ms") == pytest.approx(0.01)
    assert interval_of(None, None) is None
    with pytest.raises(UserMistake, match=r"--every: '3 apples'"):
        interval_of(None, "3 apples")


def test_of_a_run_the_longest_record_is_taken_or_the_one_named(tmp_path: Path) -> None:
    folder = run_campaign(tmp_path, "r", RECORD, ROOT / "benches" / "virtual_metrics.yaml").folder
    both = json.loads(ask(folder, "--json").output)
    assert [one["title"] for one in both] == ["NAV-1, record still of r", "HIGH-1, record still of r"]
    assert found(folder, "--dut", "NAV-1", "--record", "short")["samples"] == 600
    assert "no record 'shirt' of NAV-1. Allowed: short, still" in refused(folder, "--dut", "NAV-1", "--record", "shirt")
    assert "no DUT 'X' in this run" in refused(folder, "--dut", "X")
    assert "has no rate 'temp'" in refused(folder, "--column", "temp")
    assert "a run knows its own" in refused(folder, "--rate", 100)
