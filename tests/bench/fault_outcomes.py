"""The defined outcome of every fault, for each way in which it can come; docs/how-to/faults.md has the same table."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from tests.bench.faulty import AT_100, DUTS, SHORT, Record

CHAMBER, TABLE, SERIAL = ("chamber",), ("rate_table",), DUTS[:1]
PATIENT = SHORT.replace("quality: {slope: 5 degC/min}", "quality: {slope: 5 degC/min, lost: 5 %}")
HELD = SHORT.replace(
    "steps:\n",
    "guards:\n"
    "  - {name: chamber_alarm, watch: chamber_alarm, action: hold, clear_for: 30 s}\n"
    "  - {name: door, watch: chamber_door, action: hold, clear_for: 30 s}\n"
    "steps:\n",
    1,
)
COLD = SHORT.replace("to: 20", "to: -30")


@dataclass(frozen=True)
class Case:
    """A fault, the way it comes, and its outcome.

    about: its keys; into_s: instead of `at`, this long after the first acquisition began on a healthy bench.
    said: what the record says, in `where`: the message, the events or the reasons of the points; column: of points.csv,
    where it is counted. resumed: the run is taken up again and ends so. real_door: the chamber tells about its door.
    """

    fault: str
    how: str
    on: tuple[str, ...]
    outcome: str
    said: str = ""
    where: str = ""
    about: Record = field(default_factory=dict)
    into_s: float | None = None
    procedure: str = SHORT
    column: str = ""
    resumed: str = ""
    real_door: bool = False

    @property
    def exit_code(self) -> int:
        return {"PASS": 0, "FAIL": 1, "ERROR": 3, "refused": 3}[self.outcome]

    def script(self, on: str, first_point_s: float) -> Record:
        at = {} if self.into_s is None else {"at": f"{first_point_s + self.into_s} s"}
        return {"name": self.fault, "on": on, **at, **self.about}


def _line(fault: str, on: tuple[str, ...], few: Record, many: Record) -> Iterator[Case]:
    """What a bad line does to frames, within the quality limits and far beyond."""
    yield Case(fault, "few", on, "PASS", about=few, procedure=PATIENT, column="frames_lost")
    yield Case(fault, "many", on, "FAIL", "frames lost", "reasons", about=many)


def _replies(on: tuple[str, ...], wrong: str) -> Iterator[Case]:
    """What happens to the replies of an instrument: to some, for a minute, for good."""
    again, gone = "answers again after", {"at": "5 min"}
    for fault, said in (("no_reply", "no reply"), ("garbled_reply", wrong)):
        yield Case(fault, "some", on, "PASS", about={"probability": 0.02})
        yield Case(fault, "for a minute", on, "PASS", again, "events", {**gone, "for": "1 min"})
        yield Case(fault, "for good", on, "ERROR", said, "message", gone)
    yield Case("late_reply", "some", on, "PASS", about={"probability": 0.02, "delay": "1.5 s"})
    yield Case("late_reply", "for a minute", on, "PASS", again, "events", {**gone, "delay": "10 s", "for": "1 min"})
    yield Case("late_reply", "for good", on, "ERROR", "no reply", "message", {**gone, "delay": "1 h"})


def _trip(fault: str, reason: str) -> Case:
    return Case(fault, "once", TABLE, "ERROR", f"Fault: {reason}", "message", {**AT_100, "for": "20 s"}, resumed="PASS")


LASTING = {**AT_100, "for": "40 s"}
CASES = (
    *_line("loss", DUTS, {"probability": 5e-3}, {"probability": 5e-2}),
    *_line("burst_loss", DUTS, {"enter": 1e-3, "mean_frames": 5}, {"enter": 1e-2, "mean_frames": 10}),
    *_line("bit_error", SERIAL, {"probability": 2e-5}, {"probability": 1e-3}),
    *_line("sync_slip", SERIAL, {"probability": 5e-3}, {"probability": 5e-2}),
    Case("duplicate", "any number", DUTS, "PASS", about={"probability": 5e-2}, column="duplicates"),
    Case("frozen", "for some seconds", DUTS, "PASS", "frames frozen", "events", {"for": "3 s"}, 3.0),
    Case("frozen", "for good", DUTS, "FAIL", "output frozen", "reasons", AT_100),
    Case("spike", "few", DUTS, "PASS", about={"probability": 2e-3}, column="spikes"),
    Case("spike", "many", DUTS, "FAIL", "spikes", "reasons", {"probability": 2e-2}),
    Case("silence", "for some seconds", DUTS, "PASS", "frames lost", "events", {"for": "2 s"}, 4.0),
    Case("silence", "over whole points", DUTS, "FAIL", "no samples", "reasons", {"for": "40 s"}, -1.0, resumed="PASS"),
    Case("power_reset", "once", DUTS, "PASS", "frames lost", "events", {"for": "2 s"}, 4.0),
    Case("late", "within 2 s", DUTS, "PASS", about={"for": "1.8 s"}, into_s=9.0),
    Case("late", "longer", DUTS, "PASS", "frames lost", "events", {"for": "8 s"}, into_s=7.0),
    *_replies(CHAMBER, "the CRC does not match"),
    *_replies(TABLE, "is wrong"),
    Case("alarm", "before hour 0", CHAMBER, "refused", "the chamber reports: alarm 2 low", "message",
         {"alarm": 2, "state": "low"}),
    Case("alarm", "while it runs", CHAMBER, "ERROR", "the chamber reports alarm 1 high", "message", {"at": "5 min"}),
    Case("alarm", "with a guard that holds", CHAMBER, "PASS", "by guard 'chamber_alarm'", "events",
         {"at": "5 min", "for": "3 min"}, procedure=HELD, real_door=True),
    Case("sensor_break", "while it runs", CHAMBER, "ERROR", "the chamber reports alarm 1 high", "message",
         {"at": "5 min"}),
    Case("sensor_break", "with a guard that holds", CHAMBER, "PASS", "by guard 'chamber_alarm'", "events",
         {"at": "5 min", "for": "3 min"}, procedure=HELD, real_door=True),
    Case("door_open", "while it runs", CHAMBER, "PASS", about={"leak": 50, "at": "5 min"}),
    Case("door_open", "with a guard that holds", CHAMBER, "PASS", "by guard 'door'", "events",
         {"leak": 50, "at": "5 min", "for": "3 min"}, procedure=HELD, real_door=True),
    Case("weak_cooling", "too weak for the setpoint", CHAMBER, "ERROR", "the chamber reads", "message",
         procedure=COLD),
    _trip("fault", "drive"),
    _trip("over_speed", "over-speed"),
    _trip("e_stop", "emergency stop"),
    Case("encoder_error", "within the band of settle", TABLE, "PASS", "table off its rate", "reasons",
         {**AT_100, "rate_offset": "0.04 deg/s"}),
    Case("encoder_error", "beyond it", TABLE, "ERROR", "did not stay within", "message",
         {**LASTING, "rate_offset": "0.5 deg/s"}, resumed="PASS"),
    Case("stuck", "longer than settle waits", TABLE, "ERROR", "did not stay within", "message", LASTING,
         resumed="PASS"),
)  # fmt: skip
