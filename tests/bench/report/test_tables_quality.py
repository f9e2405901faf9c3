import dataclasses
from collections.abc import Mapping

import pytest

from bench.report import tables_quality
from bench.report.data import DutData, ReportData
from bench.report.tables import Table


def texts(table: Table) -> list[list[str]]:
    return [[cell.text for cell in row] for row in table.rows]


def with_values(dut: DutData, values: Mapping[int, Mapping[str, float | str]]) -> DutData:
    """The DUT with other values in some rows of its points."""
    points = dut.points.copy()
    for row, columns in values.items():
        for name, value in columns.items():
            points.loc[row, name] = value
    return dataclasses.replace(dut, points=points)


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
    assert rows["frames with bad status"] == ["–", "–"]


def test_resynchronisations_of_the_points_are_summed_where_the_manifest_is_silent(small: ReportData) -> None:
    duts = (with_values(small.duts[0], {3: {"resyncs": 2, "skipped_bytes": 40}, 9: {"resyncs": 1}}), small.duts[1])
    silent = dataclasses.replace(small.manifest, data_quality={})
    shown = tables_quality.quality(dataclasses.replace(small, manifest=silent, duts=duts))
    rows = {row[0]: row[1:] for row in texts(shown)}
    assert rows["resynchronisations"] == ["3", "0"]
    assert rows["bytes skipped by them"] == ["40", "0"]


def test_the_steepest_slope_stands_with_its_uncertainty(small: ReportData) -> None:
    slope = {"dut_temperature_slope_degc_min": -0.0234, "dut_temperature_slope_u_degc_min": 0.0011}
    nothing = dict.fromkeys(slope, float("nan"))
    duts = (with_values(small.duts[0], {5: slope}), with_values(small.duts[1], dict.fromkeys(range(35), nothing)))
    rows = {row[0]: row[1:] for row in texts(tables_quality.quality(dataclasses.replace(small, duts=duts)))}
    assert rows["steepest temperature slope, °C/min"] == ["0.023 ± 0.0011", "–"]


def test_the_stream_of_a_point_is_told_only_where_it_was_damaged(small: ReportData) -> None:
    failed = {"verdict": "fail", "reasons": "frames lost"}
    whole = with_values(small.duts[0], {3: failed, 4: failed})
    shown = tables_quality.points_to_look_at(dataclasses.replace(small, duts=(whole,)))
    assert shown is not None
    assert "Stream" not in [column.label for column in shown.columns]
    torn = with_values(whole, {3: {"resyncs": 2, "skipped_bytes": 40, "bad_checksum": 1}})
    shown = tables_quality.points_to_look_at(dataclasses.replace(small, duts=(torn,)))
    assert shown is not None
    stream = [column.label for column in shown.columns].index("Stream")
    told = {row[0].text: row[stream].text for row in shown.rows}
    assert (told["4"], told["5"]) == ("2 resynchronisations, 40 bytes skipped, 1 bad checksums", "–")


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
