import dataclasses
import shlex

import pytest

from bench.points import COLUMNS
from bench.report import published, tables_reference
from bench.report.data import ReportData

# The paper's two tables, typed again: max error training, validation, std training, validation.
PAPER = {
    "none": "11.5764 11.6008 4.61936 4.62689",
    "linear": "3.4732 3.5006 1.7316 1.7306",
    "ls_svm_published": "0.9287 0.9301 0.1924 0.1923",
    "bp_gradient": "0.1335 0.1764 0.03121 0.03565",
    "ts_published": "0.12055 0.14684 0.02595 0.02856",
}


def test_published_figures_are_the_papers() -> None:
    rows = {
        row.model: f"{row.max_train} {row.max_validation} {row.std_train} {row.std_validation}"
        for row in published.ROWS
    }
    assert rows == PAPER


def test_ours_stand_beside_the_published_ones(small: ReportData) -> None:
    for table, quantity in zip(tables_reference.published_tables(small), ("max_abs_dps", "std_dps"), strict=True):
        rows = {row[0].text: [cell.text for cell in row[1:]] for row in table.rows}
        metrics = small.duts[1].metrics["linear"]
        ours = [metrics[split][quantity] for split in ("random_train", "random")]
        assert [float(text) for text in rows["Linear fit"][4:6]] == pytest.approx(ours, rel=6e-4)
        assert rows["LS-SVM"][2:] == ["–"] * 4
        assert rows["T-S joint (fogbench)"][:2] == ["–", "–"]
        assert "–" not in rows["T-S joint (fogbench)"][2:]
        assert [label for label, _ in table.groups][1] == "published"


def test_notes_carry_the_runs_own_counts(small: ReportData) -> None:
    notes = " ".join(tables_reference.published_notes(small))
    assert "24 training and 11 held-back points" in notes
    assert "648" in notes
    assert "703" in notes
    assert "standard deviation" in notes
    assert "headline figures above leave whole temperatures out" in notes


def test_notes_do_not_speak_of_a_split_that_was_not_judged(small: ReportData) -> None:
    metrics = {model: {"random": splits["random"]} for model, splits in small.duts[0].metrics.items()}
    dut = dataclasses.replace(small.duts[0], metrics=metrics)
    assert "headline" not in " ".join(tables_reference.published_notes(dataclasses.replace(small, duts=(dut,))))


def test_commands_repeat_the_run(small: ReportData) -> None:
    odd = dataclasses.replace(small.manifest, run_id="a b", overrides=("soak.for=1 h",), seed=7)
    commands = dict(tables_reference.commands(dataclasses.replace(small, manifest=odd)))
    assert shlex.split(commands["repeat the run"]) == [
        *("fogbench", "run", "procedures/temperature_rate_grid.yaml", "--bench", "benches/virtual.yaml"),
        *("--seed", "7", "--set", "soak.for=1 h"),
    ]
    assert shlex.split(commands["write this report again"]) == ["fogbench", "report", "a b"]


def test_provenance_has_hashes_versions_and_instruments(small: ReportData) -> None:
    pairs = dict(tables_reference.provenance(small))
    assert pairs["Procedure SHA-256"] == small.manifest.procedure.sha256
    assert "python 3.11.9" in pairs["Versions"]
    assert pairs["chamber"] == "Watlow F4, model 5270"
    assert pairs["DUT gyro-b"] == "CAN frames by DBC, 100 Hz, can_dbc, can:gyro-b"
    assert pairs["Seed"] == "1"


def test_folders_of_many_files_are_counted() -> None:
    hashes = {"points.csv": "aa", **{f"raw/{number}.parquet": "bb" for number in range(1406)}}
    table = tables_reference.files(hashes)
    assert table is not None
    assert [row[0].text for row in table.rows] == ["points.csv", "raw/"]
    assert "1\N{NARROW NO-BREAK SPACE}406 files" in table.rows[1][1].text
    assert tables_reference.files({}) is None


def test_every_column_of_points_csv_is_explained(small: ReportData) -> None:
    explained = " ".join(row[0].text for row in tables_reference.column_glossary().rows).replace(",", "").split()
    header = (small.run_dir / "points.csv").read_text().partition("\n")[0].split(",")
    assert set(header) == set(explained) == set(COLUMNS)
