import dataclasses

import pytest

from bench.report import tables_quality
from bench.report.data import ReportData
from bench.report.tables import Table


def texts(table: Table) -> list[list[str]]:
    return [[cell.text for cell in row] for row in table.rows]


def test_quality_counts_frames_and_verdicts(small: ReportData) -> None:
    rows = {row[0]: row[1:] for row in texts(tables_quality.quality(small))}
    digits = rows["frames received"][0].replace("\N{NARROW NO-BREAK SPACE}", "")
    assert int(digits) == small.manifest.data_quality["gyro-a"]["frames"]
    assert rows["bad checksums"] == ["2", "2"]
    assert rows["frames with bad status"] == ["–", "–"]
    verdicts = [rows[f"points with verdict {word}"] for word in ("pass", "marginal", "fail")]
    assert [sum(int(row[dut]) for row in verdicts) for dut in (0, 1)] == [35, 35]
    assert float(rows["largest standard uncertainty, °/s"][0]) == pytest.approx(
        small.duts[0].points["rate_mean_u_dps"].max(), rel=0.06
    )


def test_quality_sums_the_points_where_the_manifest_is_silent(small: ReportData) -> None:
    silent = dataclasses.replace(small, manifest=dataclasses.replace(small.manifest, data_quality={}))
    rows = {row[0]: row[1:] for row in texts(tables_quality.quality(silent))}
    assert (
        int(rows["frames received"][0].replace("\N{NARROW NO-BREAK SPACE}", "")) == small.duts[0].points["frames"].sum()
    )
    assert rows["resynchronisations"] == ["–", "–"]


def test_points_to_look_at_put_failures_first_and_are_bounded(small: ReportData) -> None:
    dut = small.duts[0]
    points = dut.points.assign(verdict="marginal", reasons="frames lost")
    points.loc[30, ["verdict", "reasons"]] = ["fail", "no samples"]
    many = dataclasses.replace(dut, points=points)
    passed = dataclasses.replace(dut, points=dut.points.assign(verdict="pass"))
    shown = tables_quality.points_to_look_at(dataclasses.replace(small, duts=(many, many)))
    assert shown is not None
    assert len(shown.rows) == tables_quality.WORST_POINTS_SHOWN
    assert [row[4].text for row in shown.rows[:3]] == ["fail", "fail", "marginal"]
    assert shown.rows[0][5].text == "no samples"
    assert "70 points" in shown.caption
    assert tables_quality.points_to_look_at(dataclasses.replace(small, duts=(passed,))) is None
