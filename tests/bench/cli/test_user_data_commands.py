"""fit DATA, compensate and export as typed: what they print, write and refuse."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from bench.cli.main import main
from fitting.export.compiled import compiler
from fitting.linear import LinearCompensation
from fitting.modelfile import save_model
from fitting.takagi_sugeno import TakagiSugeno
from tests.bench.userdata.recordings import bias_file, grid_file

MAP = "temperature=T_coil,rate=omega,truth=table,group=dwell"
Typed = tuple[int, str, str]


@pytest.fixture
def fogbench(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., Typed]:
    def typed(*arguments: Any) -> Typed:
        monkeypatch.setattr(sys, "argv", ["fogbench", *map(str, arguments)])
        monkeypatch.chdir(tmp_path)
        with pytest.raises(SystemExit) as left:
            main()
        printed = capsys.readouterr()
        return int(left.value.code or 0), printed.out, printed.err

    return typed


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder with models of two gyros, as far as these commands look at it."""
    folder = tmp_path / "results" / "r1"
    rng = np.random.default_rng(0)
    inputs = rng.uniform([-30.0, -180.0], [60.0, 180.0], (60, 2))
    target = 0.97 * inputs[:, 1]
    for dut in ("FOG-A01", "FOG-B01"):
        (folder / "models" / dut).mkdir(parents=True)
        for name, model in (("linear", LinearCompensation()), ("ts_joint", TakagiSugeno(n_starts=1, max_iter=5))):
            save_model(folder / "models" / dut / f"{name}.json", model.fit(inputs, target), {"dut": dut, "model": name})
    (folder / "journal.jsonl").touch()
    return folder


def test_fit_prints_a_table_and_writes_the_model(fogbench: Callable[..., Typed], tmp_path: Path) -> None:
    grid_file(tmp_path / "d.csv", line="-30,nan,-40,d0")
    code, out, _ = fogbench("fit", "d.csv", "--map", MAP, "--model", "linear", "--model", "ts_joint", "-o", "m.json")
    assert code == 0
    assert "d.csv: 90 rows, 1 left out (1 without omega)" in out and "whole groups left out" in out
    rows = [line.split()[0] for line in out.splitlines()]
    assert rows.index("ts_joint") < rows.index("linear") and "model: m.json (ts_joint)" in out
    code, out, _ = fogbench("fit", "d.csv", "--map", MAP, "--model", "linear", "-o", "m.json", "--json")
    said = json.loads(out)
    assert said["usable"] == 89 and said["missing"] == {"omega": 1} and said["models"]["linear"]["left_out"]["n"] == 89


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("fit", "d.csv"), "where shall the model go? Say -o MODEL.json"),
        (("fit", "gone.csv", "-o", "m.json"), "there is no such file"),
        (("fit", "r1", "-o", "m.json"), "'r1' is no .csv or .parquet file"),
        (("fit", "d.csv", "--map", MAP, "-o", "m.json", "--model", "ts_jiont"), "Did you mean ts_joint?"),
        (("compensate", "m.json", "d.csv", "-o", "o.csv"), "m.json: there is no such model file"),
        (("compensate", "r1", "d.csv", "-o", "o.csv"), "4 models; say which one: --dut FOG-A01 --model linear"),
        (("compensate", "r1", "d.csv", "-o", "o.csv", "--dut", "FOG-C"), "no DUT 'FOG-C'"),
        (("export",), "export what?"),
        (("export", "r2"), "'r2' is neither a run folder nor a run id"),
        (("export", "r1", "--model", "ts_jont"), "Did you mean ts_joint?"),
        (("export", "r1", "--file", "x.json"), "give one of them"),
        (("export", "--file", "d.csv"), "not JSON"),
    ],
)
def test_mistakes_are_told_with_the_way_out(
    fogbench: Callable[..., Typed], run: Path, tmp_path: Path, arguments: tuple[str, ...], told: str
) -> None:
    grid_file(tmp_path / "d.csv")
    code, _, err = fogbench(*arguments)
    assert code == 2 and told in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["d.csv", "results"]


def test_compensate_with_a_model_of_a_run(fogbench: Callable[..., Typed], run: Path, tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("temperature,rate_dps\n20,100\n20,\n99,100\n")
    arguments = ("compensate", "r1", "d.csv", "-o", "o.csv", "--dut", "FOG-A01", "--model", "linear")
    code, out, _ = fogbench(*arguments)
    assert code == 0
    for said in ("3 rows", "temperature from 'temperature'", "guarded: 1 (33 %)", "left as nan: 1", "written: o.csv"):
        assert said in out
    assert pd.read_csv(tmp_path / "o.csv")["compensated_dps"][0] == pytest.approx(97.0, abs=1e-9)
    assert json.loads(fogbench(*arguments, "--json")[1])["missing"] == 1


def test_export_writes_every_model_of_a_run_and_what_it_costs(
    fogbench: Callable[..., Typed], run: Path, tmp_path: Path
) -> None:
    code, out, _ = fogbench("export", "r1", "-o", "c")
    assert code == 0
    names = [f"gyro_fog_{dut}_{model}" for dut in ("a01", "b01") for model in ("linear", "ts_joint")]
    assert sorted(path.name for path in (tmp_path / "c").iterdir()) == [f"{n}{s}" for n in names for s in (".c", ".h")]
    (line,) = [line.split() for line in out.splitlines() if "a01_linear.c" in line]
    # 3 coefficients and 12 numbers of the guard; operations as in tests/fitting/export
    assert line[3:5] == ["15", "120"] and line[6:9] == ["12", "5", "4"]
    assert line[5].isdigit() == (compiler() is not None)


def test_export_of_one_model_as_float_table_and_json(fogbench: Callable[..., Typed], run: Path, tmp_path: Path) -> None:
    one = ("export", "r1", "--dut", "FOG-A01", "--model", "linear")
    said = json.loads(fogbench(*one, "--precision", "float", "--json")[1])
    assert said[0]["cost"]["coefficient_bytes"] == 60 and (tmp_path / "gyro_fog_a01_linear_f.c").is_file()
    assert fogbench(*one, "--to", "csv")[0] == fogbench(*one, "--to", "json")[0] == 0
    table = pd.read_csv(tmp_path / "gyro_fog_a01_linear.csv").set_index(["table", "column"])
    assert table.loc[("coefficient", "rate_output"), "value"] == pytest.approx(0.97)
    assert table.loc[("coefficient", "temperature"), "unit"] == "deg/s per degC"
    copied = tmp_path / "gyro_fog_a01_linear.json"
    assert copied.read_bytes() == (run / "models" / "FOG-A01" / "linear.json").read_bytes()


def test_from_a_recording_to_c(fogbench: Callable[..., Typed], tmp_path: Path) -> None:
    bias_file(tmp_path / "rest.csv", sensors=2)
    columns = "temperature=T1+T2,rate=omega,truth=0"
    assert fogbench("fit", "rest.csv", "--map", columns, "--model", "linear", "-o", "rest.json")[0] == 0
    assert fogbench("compensate", "rest.json", "rest.csv", "-o", "out.csv")[0] == 0
    assert fogbench("export", "--file", "rest.json")[0] == 0
    assert "gyro_rest_compensate" in (tmp_path / "gyro_rest.h").read_text()
