"""JUnit XML, as CI systems read it: a test case for the outcome of a run, for each limit and for each DUT's points.

Elements and attributes are those that the Jenkins and Ant schemas share and pytest writes. A file is begun before the
run as one that did not come to its end, so that a process that is killed leaves no result of an earlier one behind.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from xml.etree import ElementTree

from bench.clock import utc_now
from bench.errors import BenchFailure, ExitCode, FogbenchError, Problem, UserMistake
from bench.quantities import shown
from bench.runfolder import write_atomic

if TYPE_CHECKING:
    import pandas as pd

    from bench.analyses.context import Judged
    from bench.conclude import RunEnd

Status = Literal["passed", "failure", "error"]

# What XML 1.0 cannot hold (section 2.2, Char); a garbled reply in a message may.
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
# Points of one group that are listed one by one.
LISTED = 10
UNFINISHED = "the run did not come to its end: its process died, or it still runs"


@dataclass(frozen=True)
class Case:
    """One test case. `kind` is the type of a failure or an error, `message` its headline, `details` the lines below."""

    name: str
    status: Status = "passed"
    kind: str = ""
    message: str = ""
    details: str = ""
    output: str = ""
    seconds: float = 0.0


@dataclass
class JUnitFile:
    """The JUnit file of one command; without a path nothing is written."""

    path: Path | None
    suite: str
    started_utc: str = field(default_factory=utc_now)
    told: bool = False

    def begin(self) -> None:
        """Write the file of a run that did not end. Raises UserMistake if it cannot be written."""
        if self.path is None:
            return
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._write([Case("outcome", "error", "UNFINISHED", UNFINISHED)], {})
        except OSError as error:
            raise UserMistake(
                f"--junit {self.path}: cannot be written: {error}. Choose another file. Nothing was started."
            ) from error

    def tell(self, cases: Sequence[Case], properties: Mapping[str, Any]) -> None:
        """Write what came of it. Raises BenchFailure if that cannot be written."""
        self.told = True
        if self.path is None:
            return
        try:
            self._write(cases, properties)
        except OSError as error:
            result = next((case.message for case in cases if case.status != "passed"), "all passed")
            raise BenchFailure(f"--junit {self.path}: cannot be written: {error}. The result was: {result}") from error

    def tell_run(self, end: RunEnd) -> None:
        """Write how a run ended. Raises BenchFailure if that cannot be written."""
        if self.path is not None:
            self.tell(cases_of_run(end), _properties(end))

    def tell_error(self, error: BaseException) -> None:
        """Write why there is no result; what was told before stays, and a full disk hides no error."""
        if self.path is None or self.told:
            return
        kind = type(error).__name__
        if isinstance(error, FogbenchError):
            kind = {ExitCode.USER_MISTAKE: "MISTAKE", ExitCode.INTERRUPTED: "ABORTED"}.get(error.exit_code, "ERROR")
        elif isinstance(error, KeyboardInterrupt):
            kind = "ABORTED"
        text = str(error) or kind
        with contextlib.suppress(OSError):
            self._write([Case("outcome", "error", kind, text.partition("\n")[0], text)], {})

    def _write(self, cases: Sequence[Case], properties: Mapping[str, Any]) -> None:
        assert self.path is not None
        write_atomic(self.path, document(self.suite, cases, properties, self.started_utc))


@contextlib.contextmanager
def junit_file(path: Path | None, suite: str) -> Iterator[JUnitFile]:
    """The JUnit file of a command, from before it touches anything to its end, an error included."""
    file = JUnitFile(path, suite)
    file.begin()
    try:
        yield file
    except SystemExit:
        raise
    except BaseException as error:
        file.tell_error(error)
        raise


def document(suite: str, cases: Sequence[Case], properties: Mapping[str, Any], started_utc: str) -> bytes:
    """One suite as a JUnit document, UTF-8."""
    counts = {
        "tests": str(len(cases)),
        "failures": str(sum(case.status == "failure" for case in cases)),
        "errors": str(sum(case.status == "error" for case in cases)),
        "skipped": "0",
        "time": f"{sum(case.seconds for case in cases):.3f}",
    }
    root = ElementTree.Element("testsuites", {"name": "fogbench", **counts})
    # The schemas' timestamp has no time zone; it is UTC.
    about = {"name": suite, "timestamp": started_utc.removesuffix("Z"), "hostname": "localhost"}
    element = ElementTree.SubElement(root, "testsuite", _clean({**about, **counts}))
    listed = ElementTree.SubElement(element, "properties")
    for name, value in properties.items():
        ElementTree.SubElement(listed, "property", _clean({"name": name, "value": str(value)}))
    for case in cases:
        _add(element, suite, case)
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


def _add(suite: ElementTree.Element, name: str, case: Case) -> None:
    about = {"classname": f"fogbench.{name}", "name": case.name, "time": f"{case.seconds:.3f}"}
    element = ElementTree.SubElement(suite, "testcase", _clean(about))
    if case.status != "passed":
        why = ElementTree.SubElement(element, case.status, _clean({"type": case.kind, "message": case.message}))
        why.text = _NOT_XML.sub("\ufffd", case.details or case.message)
    if case.output:
        ElementTree.SubElement(element, "system-out").text = _NOT_XML.sub("\ufffd", case.output)


def _clean(attributes: Mapping[str, str]) -> dict[str, str]:
    return {name: _NOT_XML.sub("\ufffd", value) for name, value in attributes.items()}


def case_of_check(procedure: Path, problems: Sequence[Problem], summary: str) -> Case:
    """The case of one checked procedure: its mistakes and those of the bench file, or what a run of it takes."""
    name = f"check: {procedure}"
    if not problems:
        return Case(name, output=summary)
    count = f"{len(problems)} mistake{'s' if len(problems) != 1 else ''}"
    details = "\n".join(str(problem) for problem in problems)
    return Case(name, "failure", "MISTAKE", f"{count}, the first: {problems[0]}", details)


def cases_of_run(end: RunEnd) -> list[Case]:
    """The cases of a run: its outcome, each limit, the points of each DUT."""
    import pandas as pd

    points = pd.read_parquet(end.folder / "points.parquet")
    planned = int(end.manifest["points_planned"])
    return [
        _outcome_case(end),
        *(_limit_case(item, end) for item in end.limits),
        *(_points_case(dut, points[points["dut"] == dut], planned, end) for dut in end.manifest["duts"]),
    ]


def _outcome_case(end: RunEnd) -> Case:
    statuses: dict[str, Status] = {"PASS": "passed", "FAIL": "failure"}
    status = statuses.get(end.outcome, "error")
    shown = [event for event in end.manifest.get("events", []) if event["kind"] != "note"]
    events = "\n".join(f"{event['t_s']:.1f} s, {event['kind']}: {event['text']}" for event in shown)
    seconds = float(end.manifest.get("wall_s") or 0.0)
    headline = f"{end.outcome}: {end.message}"
    return Case("outcome", status, end.outcome, headline, f"{headline}\n{events}", headline, seconds)


def _limit_case(item: Judged, end: RunEnd) -> Case:
    """A figure that could not be measured has not passed (law 9): an error if the run broke off, else a failure."""
    name = f"limit: {item.model}, {item.split}, {item.quantity}"
    as_shown = shown(item.quantity, item.limit)
    lines = [
        f"{dut}: {'not measured' if value is None else as_shown.text(value, 5)}" for dut, value in item.measured.items()
    ]
    text = "\n".join([*lines, f"limit: {as_shown.text(item.limit)}"])
    if item.passed:
        return Case(name, output=text)
    if any(value is None for value in item.measured.values()) or not item.measured:
        status: Status = "failure" if end.outcome == "FAIL" else "error"
        return Case(name, status, "not measured", f"not measured ({end.outcome})", text)
    worst = max(value for value in item.measured.values() if value is not None)
    return Case(name, "failure", "limit", f"{as_shown.text(worst, 5)} is over {as_shown.text(item.limit)}", text)


def _points_case(dut: str, points: pd.DataFrame, planned: int, end: RunEnd) -> Case:
    """The points of a DUT: bad ones by group, marginal ones only shown."""
    bad = points[~points["verdict"].isin(["pass", "marginal"])]
    marginal = points[points["verdict"] == "marginal"]
    missing = planned - points["point"].nunique()
    name, groups, shown = f"points: {dut}", list(_groups(bad, points)), "\n".join(_groups(marginal, points))
    headlines = [f"{len(bad)} of {len(points)} points failed"] if len(bad) else []
    headlines += [f"{missing} of {planned} points were not measured"] if missing > 0 else []
    if not headlines:
        return Case(name, output=shown)
    status: Status = "failure" if len(bad) or end.outcome == "FAIL" else "error"
    kind = "quality" if len(bad) else "not measured"
    return Case(name, status, kind, "; ".join(headlines), "\n".join([*headlines, *groups]), shown)


def _groups(chosen: pd.DataFrame, points: pd.DataFrame) -> Iterator[str]:
    """The chosen points by temperature and verdict: a headline for each group and a line for each of its points."""
    for (degc, verdict), group in chosen.groupby(["chamber_setpoint_degc", "verdict"], dropna=False, sort=False):
        same = points["chamber_setpoint_degc"]
        beside = int((same.isna() if degc != degc else same == degc).sum())
        where = "without a temperature setpoint" if degc != degc else f"at {degc:g} degC"
        causes = ", ".join(dict.fromkeys(cause for reasons in group["reasons"] for cause in _causes(reasons)))
        yield f"{where}: {len(group)} of {beside} points {verdict} ({causes})"
        for row in group.head(LISTED).to_dict("records"):
            rate = row["rate_setpoint_dps"]
            yield f"  point {row['point']}{'' if rate != rate else f', {rate:g} deg/s'}: {row['reasons']}"
        if len(group) > LISTED:
            yield f"  and {len(group) - LISTED} more, see points.csv"


def _causes(reasons: str) -> Iterable[str]:
    """What the reasons of a point are about, without their figures.

    >>> list(_causes("frames lost 4.2e+04 over 1000 ppm; no samples"))
    ['frames lost', 'no samples']
    """
    return (re.split(r" [-+.\d]", reason)[0] for reason in reasons.split("; ") if reason)


def _properties(end: RunEnd) -> dict[str, Any]:
    manifest = end.manifest
    return {
        "run_id": manifest["run_id"],
        "run": end.folder,
        "outcome": end.outcome,
        "exit_code": int(end.exit_code),
        "procedure": manifest["procedure"]["name"],
        "bench": manifest["bench"]["name"],
        "virtual": manifest["bench"]["virtual"],
        "seed": manifest["seed"],
        "fogbench": manifest["versions"]["fogbench"],
        "points_planned": manifest["points_planned"],
        "points_measured": manifest["points_measured"],
        "duration_s": manifest["duration_s"],
    }
