"""manifest.json of a run folder as typed values; what a run that ended early did not write is None or empty."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

OUTCOMES = ("PASS", "FAIL", "ERROR", "ABORTED")


@dataclass(frozen=True)
class Source:
    """The procedure or the bench of a run: what it is called and the hash of the file as it was run.

    experiment: id of the published experiment that a procedure follows, if it says so.
    """

    name: str = ""
    title: str = ""
    experiment: str = ""
    file: str = ""
    sha256: str = ""


@dataclass(frozen=True)
class LimitCheck:
    """One limit of the procedure; `passed` is None where the quantity was not measured."""

    model: str
    split: str
    quantity: str
    limit: float | None
    measured: Mapping[str, float | None]
    passed: bool | None


@dataclass(frozen=True)
class Event:
    """Something the journal found worth telling, at bench time `t_s`."""

    t_s: float | None
    kind: str
    text: str


@dataclass(frozen=True)
class Manifest:
    """What was run, where, when and how it ended."""

    run_id: str
    outcome: str = "UNKNOWN"
    exit_code: int | None = None
    procedure: Source = field(default_factory=Source)
    bench: Source = field(default_factory=Source)
    virtual: bool | None = None
    seed: int | None = None
    overrides: tuple[str, ...] = ()
    started_utc: str = ""
    ended_utc: str = ""
    host: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    duration_s: float | None = None
    wall_s: float | None = None
    points_planned: int | None = None
    points_measured: int | None = None
    records_planned: int | None = None
    series: tuple[Mapping[str, Any], ...] = ()
    limits: tuple[LimitCheck, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    duts: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    identities: Mapping[str, str] = field(default_factory=dict)
    data_quality: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    raw_queue: Mapping[str, float | None] = field(default_factory=dict)
    missing: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    message: str = ""
    notes: tuple[str, ...] = ()

    @property
    def records_made(self) -> int:
        """Records that were finished."""
        return len({_text(one.get("label")) for one in self.series})

    @classmethod
    def from_mapping(cls, raw: Mapping[str, Any], run_id: str) -> Manifest:
        """Read what is there; `run_id` (the folder's name) stands in where the manifest has none."""
        return cls(
            run_id=_text(raw.get("run_id")) or run_id,
            outcome=_outcome(raw.get("outcome")),
            exit_code=_whole(raw.get("exit_code")),
            procedure=_source(raw.get("procedure")),
            bench=_source(raw.get("bench")),
            virtual=_flag(_mapping(raw.get("bench")).get("virtual")),
            seed=_whole(raw.get("seed")),
            overrides=_lines(raw.get("overrides")),
            started_utc=_text(raw.get("started_utc")),
            ended_utc=_text(raw.get("ended_utc")),
            host=_host(raw.get("host")),
            versions=_texts(raw.get("versions")),
            duration_s=_number(raw.get("duration_s")),
            wall_s=_number(raw.get("wall_s")),
            points_planned=_whole(raw.get("points_planned")),
            points_measured=_whole(raw.get("points_measured")),
            records_planned=_whole(raw.get("records_planned")),
            series=tuple(_mappings(raw.get("series"))),
            limits=tuple(_limit(item) for item in _mappings(raw.get("limits"))),
            files=_texts(raw.get("files")),
            duts={str(dut): _texts(item) for dut, item in _mapping(raw.get("duts")).items()},
            identities=_texts(raw.get("identities")),
            data_quality={str(dut): _numbers(item) for dut, item in _mapping(raw.get("data_quality")).items()},
            raw_queue=_numbers(raw.get("raw_queue")),
            missing={str(dut): _texts(item) for dut, item in _mapping(raw.get("missing")).items()},
            events=tuple(_event(item) for item in _mappings(raw.get("events"))),
            message=_text(raw.get("message")).strip(),
            notes=tuple(dict.fromkeys(note for note in _lines(raw.get("notes")) if note)),
        )


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _mappings(value: Any) -> Iterable[Mapping[str, Any]]:
    return [item for item in value if isinstance(item, Mapping)] if isinstance(value, list) else []


def _text(value: Any) -> str:
    return "" if value is None else str(value)


def _texts(value: Any) -> dict[str, str]:
    return {str(key): _text(item) for key, item in _mapping(value).items()}


def _lines(value: Any) -> tuple[str, ...]:
    return tuple(map(_text, value)) if isinstance(value, list) else ()


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _numbers(value: Any) -> dict[str, float | None]:
    return {str(key): _number(item) for key, item in _mapping(value).items()}


def _whole(value: Any) -> int | None:
    number = _number(value)
    return None if number is None else int(value)


def _flag(value: Any) -> bool | None:
    return value if isinstance(value, bool) else None


def _outcome(value: Any) -> str:
    return value if value in OUTCOMES else "UNKNOWN"


def _host(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items())
    return _text(value)


def _source(value: Any) -> Source:
    raw = _mapping(value)
    return Source(*(_text(raw.get(key)) for key in ("name", "title", "experiment", "file", "sha256")))


def _limit(raw: Mapping[str, Any]) -> LimitCheck:
    return LimitCheck(
        model=_text(raw.get("model")),
        split=_text(raw.get("split")),
        quantity=_text(raw.get("quantity")),
        limit=_number(raw.get("limit")),
        measured=_numbers(raw.get("measured")),
        passed=_flag(raw.get("passed")),
    )


def _event(raw: Mapping[str, Any]) -> Event:
    return Event(_number(raw.get("t_s")), _text(raw.get("kind")), _text(raw.get("text")))
