import dataclasses
from collections.abc import Mapping

import pytest

from bench.report import tables_quality
from bench.report.data import DutData, ReportData
from bench.report.manifest import Event
from bench.report.render import render
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


def test_missing_points_stand_with_the_command_that_measures_them(small: ReportData) -> None:
    def shown(outcome: str, **missing: dict[str, str]) -> Table | None:
        manifest = dataclasses.replace(small.manifest, run_id="a run", outcome=outcome, missing=missing)
        return tables_quality.missing_points(dataclasses.replace(small, manifest=manifest))

    assert shown("PASS") is None
    lacking = {"A1": {"not_measured": "12-28", "failed": "9"}, "B1": {"failed": "3"}}
    table = shown("FAIL", **lacking)
    assert table is not None and texts(table) == [["A1", "12-28", "9"], ["B1", "–", "3"]]
    assert table.caption.endswith("fogbench resume 'a run' --missing")
    aborted = shown("ABORTED", **lacking)
    assert aborted is not None and aborted.caption.endswith("fogbench resume 'a run'")


def test_links_are_listed_up_to_a_number(small: ReportData) -> None:
    def shown(*events: Event) -> Table | None:
        manifest = dataclasses.replace(small.manifest, events=events)
        return tables_quality.links(dataclasses.replace(small, manifest=manifest))

    note = Event(1.0, "note", "hello")
    assert shown(note) is None
    lost = [Event(60.0 * number, "link", f"chamber: lost {number}") for number in range(1, 44)]
    table = shown(note, lost[0])
    assert (
        table is not None and texts(table) == [["1 min 00 s", "chamber: lost 1"]] and "The first" not in table.caption
    )
    many = shown(note, *lost)
    assert many is not None and len(many.rows) == 40 and "The first 40 of 43 are listed." in many.caption


def test_the_page_tells_what_is_missing_and_which_links_were_lost(small: ReportData) -> None:
    bare = dataclasses.replace(small, duts=())
    assert "Missing points" not in render(bare) and "Links that were lost" not in render(bare)
    manifest = dataclasses.replace(
        small.manifest,
        missing={"gyro-a": {"not_measured": "12-28"}},
        events=(Event(90.0, "link", "gyro-a: left out: silent"),),
    )
    page = render(dataclasses.replace(bare, manifest=manifest))
    assert "Missing points per DUT" in page and "12-28" in page and f"resume {manifest.run_id}" in page
    assert "gyro-a: left out: silent" in page
