"""Bench files: drivers found, settings converted, ports that clash."""

from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from bench import benchfile
from bench.benchfile import Bench, CanPort, Instrument, find_entry_point, load_bench
from bench.overrides import editor, parse_overrides
from drivers.chambers.watlow_f4 import WatlowF4
from drivers.gyros.can_dbc import CanGyro
from drivers.gyros.serial_frames import SerialGyro
from drivers.rate_tables.acutronic_acl import AcutronicAcl

ROOT = Path(__file__).parents[2]

BENCH = """\
bench: b
chamber:
  driver: watlow_f4
  port: sim://chamber
  limits: {temperature: {from: -60 degC, to: 90 degC}}
rate_table:
  driver: acutronic_acl
  port: sim://table
  settings: {acceleration: 25 deg/s^2}
  limits: {rate: 400 deg/s}
duts:
  A1:
    driver: serial_frames
    port: sim://a1
    settings: {frame: kvh_36_c100, data_rate: 50 Hz}
    limits: {rate: 200 deg/s}
  B1:
    driver: can_dbc
    port: {interface: fogsim, channel: b1}
    limits: {rate: 200 deg/s}
"""


def load(folder: Path, text: str) -> tuple[Bench | None, list[str]]:
    path = folder / "b.yaml"
    path.write_text(text)
    bench, problems = load_bench(path)
    assert (bench is None) is bool(problems)
    return bench, [str(problem).replace(str(path), "b.yaml") for problem in problems]


def loaded(folder: Path, text: str = BENCH) -> Bench:
    bench, problems = load(folder, text)
    assert bench is not None, problems
    return bench


@pytest.mark.parametrize(
    ("identity", "found", "right"),
    [
        (None, "anything", True),
        ("Watlow F4, model 5270", "Watlow F4, model 5270", True),
        ("Watlow F4", "Watlow F4, model 5270", False),
        ("Watlow F4*", "Watlow F4, model 5270", True),
        ("*5270", "Watlow F4, model 5270", True),
        ("*F4*5270*", "Watlow F4, model 5270", True),
        ("Watlow F.*", "Watlow F4", False),
        ("watlow*", "Watlow F4", False),
    ],
)
def test_an_identity_is_the_whole_text_with_stars_for_any(
    tmp_path: Path, identity: str | None, found: str, right: bool
) -> None:
    chamber = loaded(tmp_path).chamber
    assert chamber is not None and replace(chamber, identity=identity).is_it(found) is right


def test_links_have_sane_defaults_and_take_quantities(tmp_path: Path) -> None:
    links = loaded(tmp_path).file.links
    assert (links.patience_s, links.first_wait_s, links.longest_wait_s, links.silent_after_s) == (300, 0.5, 10, 60)
    changed = loaded(tmp_path, BENCH + "links: {patience: 2 min, silent_after: 10 s}\n").file.links
    assert (changed.patience_s, changed.silent_after_s) == (120.0, 10.0)
    (problem,) = load(tmp_path, BENCH + "links: {first_wait: 0 s}\n")[1]
    assert "first_wait" in problem and "above 0 s" in problem


def mistakes(folder: Path, old: str, new: str) -> list[str]:
    assert BENCH.count(old) == 1
    return load(folder, BENCH.replace(old, new))[1]


def test_every_instrument_has_its_driver_settings_and_address(tmp_path: Path) -> None:
    bench = loaded(tmp_path)
    assert bench.chamber is not None
    assert bench.rate_table is not None
    assert [item.driver_class for item in bench.instruments] == [WatlowF4, AcutronicAcl, SerialGyro, CanGyro]
    assert [item.role for item in bench.instruments] == ["chamber", "rate_table", "dut", "dut"]
    assert [item.address for item in bench.instruments] == ["sim://chamber", "sim://table", "sim://a1", "can:b1"]
    assert [item.where for item in bench.instruments][1:3] == ["rate table at sim://table", "A1 at sim://a1"]
    assert bench.chamber.settings == WatlowF4.Settings()
    assert bench.rate_table.settings == replace(AcutronicAcl.Settings(), acceleration_dps2=25.0)
    assert bench.duts["A1"].settings == SerialGyro.Settings(frame="kvh_36_c100", data_rate_hz=50.0)
    assert bench.duts["A1"].settings_mapping == {"frame": "kvh_36_c100", "baud": 921_600, "data_rate_hz": 50.0}
    assert list(bench.duts) == ["A1", "B1"]
    assert bench.virtual


def test_defaults_of_limits_and_safe_states(tmp_path: Path) -> None:
    file = loaded(tmp_path).file
    assert file.chamber is not None
    assert file.rate_table is not None
    assert (file.chamber.limits.ramp_degc_min, file.chamber.safe.action) == (5.0, "hold")
    assert (file.rate_table.safe.release, file.rate_table.safe.timeout_s) == (True, 120.0)
    assert file.site.latitude_deg is None
    assert isinstance(file.duts["B1"].port, CanPort)
    assert file.duts["B1"].port.bitrate == 1_000_000


def test_a_bench_may_do_without_chamber_and_table(tmp_path: Path) -> None:
    text = BENCH[: BENCH.index("chamber")] + BENCH[BENCH.index("duts") :]
    bench = loaded(tmp_path, text)
    assert (bench.chamber, bench.rate_table) == (None, None)
    assert len(list(bench.instruments)) == 2


@pytest.mark.parametrize(("name", "virtual"), [("virtual", True), ("lab_example", False)])
def test_the_benches_of_the_house(name: str, virtual: bool) -> None:
    bench, problems = load_bench(ROOT / "benches" / f"{name}.yaml")
    assert problems == []
    assert bench is not None
    assert bench.virtual is virtual
    assert bench.file.bench == name
    if not virtual:
        assert not any(item.simulated for item in bench.instruments)
        assert bench.duts["FOG-0143"].address == "can:socketcan/can0"


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("driver: watlow_f4", "driver: watlow_f5", "b.yaml:3:11: unknown driver 'watlow_f5' for a chamber."),
        ("driver: acutronic_acl", "driver: watlow_f4", "b.yaml:7:11: unknown driver 'watlow_f4' for a rate table."),
        (
            "driver: can_dbc",
            "driver: can",
            "b.yaml:18:13: unknown driver 'can' for a DUT. Allowed: can_dbc, serial_frames.",
        ),
        ("port: sim://a1", "port: sim://table", "b.yaml:14:11: A1 is on sim://table, where rate table already is."),
        ("acceleration: 25 deg/s^2", "acceleration: 25 deg/s", "b.yaml:9:28: 'acceleration': '25 deg/s' has the unit"),
        ("acceleration: 25 deg/s^2", "accel: 25 deg/s^2", "b.yaml:9:14: unknown key 'accel'. Allowed: acceleration,"),
        ("acceleration: 25 deg/s^2", "axis: 12", "b.yaml:9:20: axis: 12; allowed are 1..9"),
        ("frame: kvh_36_c100", "frame: kvh_37", "b.yaml:15:23: frame"),
        ("data_rate: 50 Hz", "data_rate: 50 MHz", "b.yaml:15:47: 'data_rate': '50 MHz' has the unit 'MHz'"),
        ("data_rate: 50 Hz", "data_rate: 5 kHz", "b.yaml:15:47: data_rate: 5000 Hz of 36-byte frames needs"),
        ("bench: b", "bench: b/c", "b.yaml:1:8: 'bench': 'b/c' cannot be a name."),
        (
            "    limits: {rate: 200 deg/s}\n  B1",
            "    limts: {rate: 200 deg/s}\n  B1",
            "b.yaml:12:3: the key 'limits' is missing",
        ),
        ("port: sim://chamber", "port: [sim://chamber]", "b.yaml:4:9: 'port': expected text, not a list."),
        ("from: -60 degC, to: 90 degC", "from: 90 degC, to: -60 degC", "b.yaml:5:25: 'from' is above 'to'"),
        (
            "bench: b",
            "bench: b\nsite: {latitude: 95 deg}",
            "b.yaml:2:18: 'latitude': must be at most 90 deg, not '95 deg'.",
        ),
    ],
)
def test_mistakes(tmp_path: Path, old: str, new: str, problem: str) -> None:
    found = mistakes(tmp_path, old, new)
    assert found[0].startswith(problem), found


def test_a_bench_without_duts(tmp_path: Path) -> None:
    assert "at least one DUT" in load(tmp_path, BENCH[: BENCH.index("duts")])[1][0]
    assert "at least one DUT" in load(tmp_path, BENCH[: BENCH.index("duts")] + "duts: {}\n")[1][0]


SECOND = """\
  C1:
    driver: can_dbc
    port: {{interface: fogsim, channel: b1{bitrate}}}
    settings: {{can_id: {identifier}}}
    limits: {{rate: 200 deg/s}}
"""


def test_gyros_may_share_a_can_bus_with_identifiers_of_their_own(tmp_path: Path) -> None:
    bench = loaded(tmp_path, BENCH + SECOND.format(bitrate="", identifier=0x1A5))
    assert bench.duts["B1"].address == bench.duts["C1"].address


def test_gyros_that_send_the_same_identifier_cannot_be_told_apart(tmp_path: Path) -> None:
    bench = loaded(tmp_path)
    identifier = CanGyro.can_id(bench.duts["B1"].settings)
    (problem,) = load(tmp_path, BENCH + SECOND.format(bitrate="", identifier=identifier))[1]
    assert problem.startswith("b.yaml:23:11: C1 is on can:b1, where B1 already is")
    assert f"same identifier {identifier:X}" in problem
    assert "can_id" in problem


def test_a_bus_has_one_bitrate(tmp_path: Path) -> None:
    (problem,) = load(tmp_path, BENCH + SECOND.format(bitrate=", bitrate: 500000", identifier=0x1A5))[1]
    assert problem.startswith("b.yaml:23:11: C1 is on can:b1, where B1 already is, at 1000000 and not 500000 bit/s")


def test_a_bench_is_all_virtual_or_all_real(tmp_path: Path) -> None:
    (problem,) = mistakes(tmp_path, "port: sim://chamber", "port: /dev/ttyUSB0")
    assert problem.startswith("b.yaml:4:9: some ports are simulated and some real (chamber at /dev/ttyUSB0)")


def test_the_same_channel_of_another_interface_is_another_bus() -> None:
    def bus(interface: str) -> Instrument:
        port = CanPort.model_validate({"interface": interface, "channel": "x"})
        return Instrument("dut", "A", "can_dbc", port, CanGyro, CanGyro.Settings(), ("duts", "A"))

    assert bus("socketcan").address == "can:socketcan/x"
    assert bus("pcan").address == "can:pcan/x"
    assert (bus("fogsim").simulated, bus("pcan").simulated) == (True, False)


def test_files_named_in_settings_are_looked_for_beside_the_bench_file(tmp_path: Path) -> None:
    packaged = ROOT / "drivers" / "gyros" / "frames" / "kvh_36.yaml"
    (tmp_path / "mine.yaml").write_bytes(packaged.read_bytes())
    bench = loaded(tmp_path, BENCH.replace("frame: kvh_36_c100", "frame: mine.yaml"))
    assert bench.duts["A1"].settings.frame == str(tmp_path / "mine.yaml")


def test_a_driver_that_cannot_be_imported_is_a_mistake_and_no_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = EntryPoint("watlow_f4", "no_such_package.driver:Driver", "fogbench.chambers")
    find = find_entry_point
    monkeypatch.setattr(
        benchfile, "find_entry_point", lambda group, name: broken if name == "watlow_f4" else find(group, name)
    )
    (problem,) = load(tmp_path, BENCH)[1]
    assert problem.startswith("b.yaml:3:11: the driver 'watlow_f4' (no_such_package.driver:Driver) cannot be loaded")
    assert "no_such_package" in problem


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    bench, problems = load_bench(tmp_path / "nowhere.yaml")
    assert bench is None
    assert "No such file" in str(problems[0])


def test_a_bench_may_be_changed_before_it_is_checked(tmp_path: Path) -> None:
    path = tmp_path / "b.yaml"
    path.write_text(BENCH)
    edit = editor(
        parse_overrides(["bench.duts.A1.settings.data_rate=25 Hz", "bench.chamber.settings.baud=9600"]), "bench"
    )
    bench, problems = load_bench(path, edit)
    assert problems == []
    assert bench is not None
    assert bench.duts["A1"].settings.data_rate_hz == 25.0
    assert bench.chamber is not None
    assert bench.chamber.settings.baud == 9600


def test_settings_replaced_as_a_whole_are_not_judged_by_the_lines_they_replace(tmp_path: Path) -> None:
    path = tmp_path / "b.yaml"
    path.write_text(BENCH)
    (problem,) = load_bench(path, editor(parse_overrides(["bench.duts.A1.settings={baud: 9600}"]), "bench"))[1]
    assert str(problem).startswith("--set bench.duts.A1.settings={baud: 9600}: data_rate: 100 Hz")


def test_entry_points_are_found_by_group_and_name() -> None:
    found = find_entry_point("fogbench.chambers", "watlow_f4")
    assert found is not None
    assert found.load() is WatlowF4
    assert find_entry_point("fogbench.chambers", "acutronic_acl") is None
