"""Models from users' recordings: what is fitted, what is said, what is refused."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.errors import InvalidFiles, UserMistake
from bench.userdata.fit import Outcome, fit_recording
from bench.userdata.judging import LEFT_OUT, RANDOM, Folds
from bench.userdata.recording import read_recording
from fitting.modelfile import load_model
from fitting.modelfiles.columns import BIAS_ERROR_DPS, RATE
from tests.bench.userdata.recordings import NOISE_DPS, bias_file, grid_file

MAP = "temperature=T_coil,rate=omega,truth=table"


def fit(path: Path, columns: str, *models: str) -> Outcome:
    return fit_recording(path, (columns,), models, path.parent / "m.json")


def test_a_grid_gives_the_true_rate_down_to_its_noise(tmp_path: Path) -> None:
    path = grid_file(tmp_path / "d.csv")
    outcome = fit(path, MAP + ",group=dwell")
    assert outcome.before.std_dps > 0.5
    for split in (RANDOM, LEFT_OUT):
        assert outcome.models[0].judged[split].std_dps < 5.0 * NOISE_DPS
    assert outcome.models[0].judged[LEFT_OUT].n == 90 and not outcome.notes
    model = load_model(tmp_path / "m.json")
    fresh = pd.read_csv(grid_file(tmp_path / "other.csv", seed=5))
    compensated, outside = model.compensate(temperature=fresh["T_coil"], rate_output=fresh["omega"])
    assert np.std(compensated - fresh["table"]) < 2.0 * NOISE_DPS and outside.mean() < 0.1


def test_the_model_says_where_it_is_from(tmp_path: Path) -> None:
    path = grid_file(tmp_path / "d.csv")
    outcome = fit(path, MAP, "linear")
    document = json.loads((tmp_path / "m.json").read_text())
    assert document["meta"]["data"] == {
        "file": "d.csv",
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "map": {"temperature": "T_coil", "rate": "omega", "truth": "table"},
    }
    assert document["meta"]["model"] == "linear" and document["kind"] == "linear"
    left_out = outcome.models[0].judged[LEFT_OUT].std_dps
    assert document["figures_of_merit"]["left_out"]["std_dps"] == left_out


def test_of_several_models_the_best_at_groups_left_out_is_written(tmp_path: Path) -> None:
    outcome = fit(grid_file(tmp_path / "d.csv"), MAP, "linear", "ts_joint")
    assert [one.name for one in outcome.models] == ["ts_joint", "linear"]
    assert load_model(tmp_path / "m.json").document["kind"] == "takagi_sugeno"


def test_no_temperature_effect_no_temperature_term(tmp_path: Path) -> None:
    outcome = fit(grid_file(tmp_path / "d.csv", seed=1, temperature_effect=False), MAP + ",group=dwell")
    model = load_model(tmp_path / "m.json")
    assert [column.name for column in model.inputs] == ["rate_output"] and model.output == RATE
    assert "no temperature effect" in outcome.notes[0] and "no temperature term" in outcome.notes[0]
    kept = fit(tmp_path / "d.csv", MAP + ",group=dwell", "ts_joint")
    assert "kept because it was named" in kept.notes[0]
    assert len(load_model(tmp_path / "m.json").inputs) == 2


def test_a_bias_run_gives_the_error(tmp_path: Path) -> None:
    outcome = fit(bias_file(tmp_path / "d.csv"), "temperature=T1,rate=omega,truth=0")
    model = load_model(tmp_path / "m.json")
    assert model.output == BIAS_ERROR_DPS
    assert model.predict([0.0, 40.0]) == pytest.approx([0.01, 0.014], abs=2e-4)
    assert outcome.models[0].judged[LEFT_OUT].std_dps < 1.1 * NOISE_DPS < 0.2 * outcome.before.std_dps
    again = fit(tmp_path / "d.csv", "temperature=T1,rate=omega,truth=0.01")
    assert load_model(tmp_path / "m.json").predict(0.0) == pytest.approx(0.0, abs=2e-4)
    assert again.recording.mapped["truth"] == "0.01"


def test_a_bias_run_without_temperature_effect_gives_its_mean(tmp_path: Path) -> None:
    outcome = fit(bias_file(tmp_path / "d.csv", 0.0), "temperature=T1,rate=omega,truth=0")
    assert "no temperature effect" in outcome.notes[0] and outcome.models[0].name == "mean"
    mean = outcome.recording.before.mean()
    assert load_model(tmp_path / "m.json").predict([-10.0, 20.0, 50.0]) == pytest.approx([mean] * 3, rel=1e-12)


def test_several_temperatures_and_none(tmp_path: Path) -> None:
    path = bias_file(tmp_path / "d.csv", sensors=2)
    fit_recording(path, ("temperature=T1+T2,rate=omega", "truth=0"), ("linear",), tmp_path / "m.json")
    assert [column.name for column in load_model(tmp_path / "m.json").inputs] == ["temperature_1", "temperature_2"]
    outcome = fit(grid_file(tmp_path / "g.csv"), "rate=omega,truth=table")
    assert [column.name for column in load_model(tmp_path / "m.json").inputs] == ["rate_output"]
    assert outcome.models[0].name == "linear"


def test_of_a_saturating_gyro_without_temperature_a_curve_is_fitted(tmp_path: Path) -> None:
    rate = np.linspace(-200.0, 200.0, 81)
    given = np.sin(0.004 * rate) / 0.004 + NOISE_DPS * np.random.default_rng(0).standard_normal(81)
    pd.DataFrame({"rate": given, "truth": rate}).sample(frac=1.0, random_state=0).to_csv(
        tmp_path / "d.csv", index=False
    )
    outcome = fit_recording(tmp_path / "d.csv", (), (), tmp_path / "m.json")
    assert outcome.models[0].name == "polynomial" and outcome.models[0].judged[LEFT_OUT].std_dps < 0.1
    assert load_model(tmp_path / "m.json").document["kind"] == "polynomial"


def test_rows_without_a_value_are_left_out_and_counted(tmp_path: Path) -> None:
    path = grid_file(tmp_path / "d.csv", line="-30.0,,-40,d0")
    outcome = fit(path, MAP, "linear")
    assert outcome.recording.rows == 90 and len(outcome.recording.target) == 89
    assert outcome.recording.missing == {"omega": 1}


def test_groups_are_left_out_whole(tmp_path: Path) -> None:
    recording = read_recording(grid_file(tmp_path / "d.csv"), (MAP, "group=dwell"))
    assert recording.groups is not None
    folds = Folds.of(recording)
    for group in range(10):
        assert len(set(folds.by_group[recording.groups == group])) == 1
    assert len(set(folds.by_group)) == 6


def test_columns_of_the_usual_names_need_no_map(tmp_path: Path) -> None:
    path = grid_file(tmp_path / "d.csv")
    text = path.read_text().replace("T_coil,omega,table", "temperature_degc,rate_dps,truth")
    path.write_text(text)
    recording = read_recording(path, ())
    assert recording.mapped == {"temperature": "temperature_degc", "rate": "rate_dps", "truth": "truth"}


def test_parquet_gives_the_same_model(tmp_path: Path) -> None:
    path = grid_file(tmp_path / "d.csv")
    pd.read_csv(path).to_parquet(tmp_path / "d.parquet")
    first, second = (read_recording(one, (MAP,)) for one in (path, tmp_path / "d.parquet"))
    assert np.array_equal(first.inputs, second.inputs) and np.array_equal(first.target, second.target)


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ("temperature=Tcoil,rate=omega,truth=table", "no column 'Tcoil' for the temperature.*Did you mean T_coil"),
        ("temperature=T_coil,truth=table", "which column is the rate.*--map rate=COL.*T_coil, omega"),
        ("temperature=T_coil,rate=omega", r"which column is the truth.*truth=0 for a gyro at rest"),
        ("temperature=T_coil,rate=omega,truth=omega", "'omega' is mapped twice"),
        ("temperature=T_coil,rate=omega+table,truth=0", "the rate is one column"),
        ("rate=omega,truth=0", r"only the mean error can be known: 0\.1.* deg/s"),
        ("temperature=T_coil,rate=omega,truth=dwell", r"d.csv:2:4: column 'dwell' has 'd0'"),
    ],
)
def test_what_cannot_be_is_refused_with_the_way_out(tmp_path: Path, columns: str, told: str) -> None:
    with pytest.raises(UserMistake, match=told):
        fit(grid_file(tmp_path / "d.csv"), columns)
    assert not (tmp_path / "m.json").exists()


def test_a_cell_that_is_no_number_is_named_with_its_place(tmp_path: Path) -> None:
    with pytest.raises(InvalidFiles, match=r"d.csv:5:2: column 'omega' has 'off'"):
        fit(grid_file(tmp_path / "d.csv", line="-30.0,off,-40,d0"), MAP)


def test_a_constant_truth_and_too_few_rows_are_refused(tmp_path: Path) -> None:
    path = grid_file(tmp_path / "d.csv")
    lines = path.read_text().splitlines()
    (tmp_path / "few.csv").write_text("\n".join(lines[:7]) + "\n")
    with pytest.raises(UserMistake, match=r"6 usable rows of 6; a fit and its check take at least 8"):
        fit(tmp_path / "few.csv", MAP)
    table = pd.read_csv(path).assign(table=0.0)
    table.to_csv(tmp_path / "still.csv", index=False)
    with pytest.raises(UserMistake, match=r"the truth 'table' is 0 deg/s in every row.*--map truth=0"):
        fit(tmp_path / "still.csv", MAP)


def test_one_group_is_too_few(tmp_path: Path) -> None:
    table = pd.read_csv(grid_file(tmp_path / "d.csv")).assign(dwell="a")
    table.to_csv(tmp_path / "d.csv", index=False)
    with pytest.raises(UserMistake, match="all rows are of one group"):
        fit(tmp_path / "d.csv", MAP + ",group=dwell")


def test_the_data_are_never_overwritten(tmp_path: Path) -> None:
    path = grid_file(tmp_path / "d.csv")
    with pytest.raises(UserMistake, match="never overwritten"):
        fit_recording(path, (MAP,), (), path)


def history_file(path: Path, share: float) -> Path:
    """A gyro at rest, a row every 50 s, whose bias follows a lag of 600 s; it begins at a standstill."""
    temperature = 20.0 + 20.0 * np.cos(np.arange(1500) / 20.0) + 10.0 * np.cos(np.arange(1500) / 33.0)
    slow = np.empty(1500)
    slow[0] = temperature[0]
    for k in range(1, 1500):
        slow[k] = slow[k - 1] + (temperature[k] - slow[k - 1]) * (1.0 - np.exp(-50.0 / 600.0))
    error = 1e-4 * temperature + share * 1e-3 * (temperature - slow)
    error += NOISE_DPS * np.random.default_rng(0).standard_normal(1500)
    table = pd.DataFrame({"s": 50.0 * np.arange(1500), "T": temperature, "w": error})
    table.round(7).to_csv(path, index=False)
    return path


def test_history_is_used_where_it_helps_and_only_there(tmp_path: Path) -> None:
    columns = "temperature=T,rate=w,truth=0,time=s"
    outcome = fit(history_file(tmp_path / "d.csv", 1.0), columns)
    assert outcome.models[0].name == "lag_bank_history" and "history of the temperature helps" in outcome.notes[-1]
    assert outcome.models[0].judged[LEFT_OUT].std_dps < 1.5 * NOISE_DPS < 0.2 * outcome.before.std_dps
    model, table = load_model(tmp_path / "m.json"), pd.read_csv(tmp_path / "d.csv")
    assert model.document["kind"] == "thermal_cycle" and model.document["parameters"]["period_s"] == 50.0
    left, _ = model.compensate(table["T"], rate_dps=table["w"])
    assert np.std(left) < 1.2 * NOISE_DPS
    outcome = fit(history_file(tmp_path / "d.csv", 0.0), columns)
    assert outcome.models[0].name == "lag_bank" and "does not help" in outcome.notes[-1]


def test_a_time_that_is_not_even_is_refused(tmp_path: Path) -> None:
    table = pd.read_csv(history_file(tmp_path / "d.csv", 0.0))
    table.drop(index=17).to_csv(tmp_path / "d.csv", index=False)
    with pytest.raises(UserMistake, match=r"must rise evenly.*50 s, between rows 17 and 18 100 s pass"):
        fit(tmp_path / "d.csv", "temperature=T,rate=w,truth=0,time=s")
    table.assign(T=table["T"].where(table["T"] > -5.0)).to_csv(tmp_path / "d.csv", index=False)
    with pytest.raises(UserMistake, match="rows have a value missing"):
        fit(tmp_path / "d.csv", "temperature=T,rate=w,truth=0,time=s")
