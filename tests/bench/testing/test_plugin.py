"""The pytest plugin, used as a user's repository would use it."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.errors import BenchFailure, InvalidFiles, UserMistake
from bench.testing.virtual import PACKAGED, VirtualBench
from tests.bench.campaigns import ROOT, VIRTUAL, write

pytest_plugins = ["pytester"]

SHORT = """\
procedure: short
raw: none
quality: {slope: 5 degC/min}
steps:
  - sweep:
      rate: {from: -100 deg/s, to: 100 deg/s, step: 100 deg/s}
      steps:
        - settle: {band: 0.02 deg/s, for: 0.5 s, timeout: 30 s}
        - acquire: {count: 20, every: 0.2 s}
"""

Maker = Callable[..., VirtualBench]


@pytest.fixture
def short(tmp_path: Path) -> Path:
    return write(tmp_path, "short.yaml", SHORT)


def test_a_run_and_what_a_test_can_ask_of_it(virtual_bench: Maker, short: Path, tmp_path: Path) -> None:
    run = virtual_bench().run(short)
    assert (run.outcome, run.exit_code, run.message) == ("PASS", 0, "every point measured; no limit was set")
    assert run.folder == tmp_path / "results" / "run-1"
    assert len(run.points) == 6 and set(run.points["verdict"]) == {"pass"}
    assert run.losses["FOG-A01"]["lost"] == 0 and run.faults == []
    assert run.journal[0]["kind"] == "journal" and run.events[-1]["kind"] == "safe"
    assert next(iter(run.timeline)) == "t_s" and len(run.timeline)
    assert run.metrics == {} and run.limits == []
    assert repr(run).startswith("<short: PASS (0): every point")
    assert not (run.folder / "report.html").exists()
    assert run.report.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_runs_are_numbered_and_equal_for_equal_benches(virtual_bench: Maker, short: Path) -> None:
    bench = virtual_bench(VIRTUAL)
    first, second = bench.run(short), virtual_bench().run(short)
    other = bench.run(short, seed=7)
    same = bench.simulation(seed=7).run(short)
    assert [run.folder.name for run in (first, second, other, same)] == ["run-1", "run-2", "run-3", "run-4"]
    assert first.points.equals(second.points)
    assert other.points.equals(same.points) and not other.points.equals(first.points)


def test_the_packaged_bench_is_the_one_in_benches() -> None:
    assert PACKAGED.read_bytes() == VIRTUAL.read_bytes()


def test_faults_are_added_to_those_of_the_file_and_leave_the_bench_they_were_added_to(
    virtual_bench: Maker, short: Path, tmp_path: Path
) -> None:
    text = f"{VIRTUAL.read_text(encoding='utf-8')}  faults: [{{name: loss, on: FOG-A01, probability: 0.01}}]\n"
    lossy = virtual_bench(write(tmp_path, "lossy.yaml", text))
    both = lossy.fault("late", on="FOG-B01", at="5 s", for_="1 s")
    assert "late on FOG-B01" in repr(both) and "late" not in repr(lossy)
    run = both.run(short)
    assert {(record["fault"], record["instrument"]) for record in run.faults} == {
        ("loss", "FOG-A01"),
        ("late", "FOG-B01"),
    }
    assert run.losses["FOG-A01"]["lost"] > 0 and run.losses["FOG-B01"]["lost"] == 0
    assert {record["fault"] for record in lossy.run(short).faults} == {"loss"}


def test_a_broken_table_is_an_outcome_and_can_be_resumed(virtual_bench: Maker, short: Path) -> None:
    run = virtual_bench().fault("fault", on="rate_table", at="20 s", reason="door").run(short)
    assert (run.outcome, run.exit_code) == ("ERROR", 3)
    assert "door" in run.message
    resumed = run.resume()
    assert resumed.folder == run.folder and resumed.manifest["attempts"] == 2


def test_a_bench_that_does_not_answer_is_an_error_of_the_test(virtual_bench: Maker, short: Path) -> None:
    with pytest.raises(BenchFailure, match="no reply"):
        virtual_bench().fault("no_reply", on="chamber").run(short)


def test_a_real_bench_file_is_run_on_simulators(virtual_bench: Maker, short: Path, tmp_path: Path) -> None:
    lab = virtual_bench("benches/lab_example.yaml").simulation(
        chamber={"cooling_power": "800 W"},
        duts={"FOG-0142": {"class": "tactical", "noise": {"arw": "0.1 deg/sqrt(h)"}}},
    )
    run = lab.run(short)
    assert run.outcome == "PASS" and run.manifest["bench"]["virtual"]
    ports = {serial: about["port"] for serial, about in run.manifest["duts"].items()}
    assert ports == {"FOG-0142": "sim://duts-FOG-0142", "FOG-0143": "can:can0"}
    assert "bench.simulation.duts.FOG-0142.noise.arw" in str(run.manifest["overrides"])


def test_no_test_opens_a_real_port(virtual_bench: Maker, short: Path, tmp_path: Path) -> None:
    bench = virtual_bench().set("bench.chamber.port", "/dev/null").set("bench.rate_table.port", "/dev/null2")
    real = {"interface": "socketcan", "channel": "can9"}
    bench = bench.set("bench.duts.FOG-A01.port", "/dev/null3").set("bench.duts.FOG-B01.port", real)
    with pytest.raises(UserMistake, match="a test opens no real ports, and was given chamber at /dev/null, "):
        bench.run(short)
    assert not (tmp_path / "results").exists()


def test_check_and_dry_run(virtual_bench: Maker, short: Path) -> None:
    bench = virtual_bench()
    checked = bench.check(short)
    assert (checked.points, checked.duts) == (3, ["FOG-A01", "FOG-B01"]) and checked.duration_s > 12
    rehearsed = bench.dry_run(short)
    assert rehearsed.failure is None and rehearsed.points == 3 and rehearsed.duration_s > checked.duration_s
    slow = bench.simulation(rate_table={"max_rate": "60 deg/s"}).dry_run(short)
    assert slow.failure and "beyond the limit of 60" in slow.failure


def test_set_changes_single_values(virtual_bench: Maker, short: Path) -> None:
    path = "procedure.steps.0.sweep.rate"
    assert virtual_bench().check(short, set={path: ["10 deg/s"]}).points == 1
    with pytest.raises(InvalidFiles, match="50 deg/s is above the rate table's limit"):
        virtual_bench().set("bench.rate_table.limits.rate", "20 deg/s").check(short, set={path: ["50 deg/s"]})
    with pytest.raises(UserMistake, match="not path=value"):
        virtual_bench().set("limits.rate", 1)


def test_a_mistake_comes_without_the_inside_of_the_product(virtual_bench: Maker, short: Path) -> None:
    with pytest.raises(InvalidFiles, match="Did you mean door_open") as raised:
        virtual_bench().fault("door_opn", on="chamber").run(short)
    assert [entry.name for entry in raised.traceback][1:] == ["surfaced"]
    assert raised.value.__cause__ is None and raised.value.__suppress_context__


def test_in_a_repository_of_its_own(pytester: pytest.Pytester) -> None:
    """Found by its entry point; files beside pytest.ini or beside the test; failures that can be read."""
    pytester.makeini("[pytest]\n")
    pytester.mkdir("procedures").joinpath("short.yaml").write_text(SHORT, encoding="utf-8")
    tests = pytester.mkdir("tests")
    tests.joinpath("beside.yaml").write_text(SHORT.replace("rate: {", "rate: {bla: 1, "), encoding="utf-8")
    tests.joinpath("test_it.py").write_text(
        """
import pytest

@pytest.fixture(scope="module")
def run(session_virtual_bench):
    return session_virtual_bench().run("procedures/short.yaml")

def test_good(run):
    assert run.outcome == "PASS"

def test_same_run(run):
    assert len(run.points) == 6

def test_fails(virtual_bench):
    run = virtual_bench().fault("loss", on="FOG-A01", probability=0.1).run("procedures/short.yaml")
    assert run.outcome == "PASS"

def test_mistaken(virtual_bench):
    virtual_bench().run("beside.yaml")
""",
        encoding="utf-8",
    )
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider", "--junitxml", "j.xml")
    result.assert_outcomes(passed=2, failed=2)
    result.stdout.fnmatch_lines(
        [
            "*Captured fogbench call*",
            "<short: FAIL (1): 3 of 6 points failed*run-1*",
            "*beside.yaml:6:*unknown key 'bla'*",
        ]
    )
    result.stdout.no_fnmatch_line("*bench/check.py*")


def test_the_plugin_costs_other_test_suites_nothing() -> None:
    """Every pytest of the environment loads it: the product must not come along."""
    code = (
        "import sys, pytest\n"
        "before = set(sys.modules)\n"
        "import bench.testing.plugin\n"
        "print(sorted(set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['bench', 'bench.testing', 'bench.testing.plugin']"
