"""The record verb: listens to every DUT while the steps of a record run, and keeps what it hears."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, cast

from bench.engine import Engine
from bench.instruments import Gyro
from bench.procedure.conditions import Quality
from bench.procedure.language import Record
from bench.procedure.plan import PlannedStep
from bench.rawstore import RawFile, RawStore, meaning_as_metadata
from bench.series import Columns, Growing, part_name
from drivers.codecs.batch import FrameBatch
from drivers.codecs.counters import Losses


@dataclass
class _Series:
    """One DUT of the record under way; one that is off when the record begins has no beginning yet."""

    gyro: Gyro
    growing: Growing
    before: Losses
    started_at_s: float | None


@dataclass
class _Open:
    """The record under way."""

    number: int
    step: PlannedStep
    every_s: float
    started_at_s: float
    series: dict[str, _Series]
    now: Callable[[], float]
    disturbed: list[str] = field(default_factory=list)


class SeriesRecorder:
    """Keeps the time series of a run: parts to the raw store, one journal record per finished series."""

    def __init__(self, quality: Quality, store: RawStore, frames_too: bool) -> None:
        self._quality, self._store, self._frames_too = quality, store, frames_too
        self._open: _Open | None = None

    @property
    def active(self) -> bool:
        """Whether a record is under way."""
        return self._open is not None

    def begin(self, engine: Engine, step: PlannedStep) -> None:
        """Listen from now on, to a DUT that is off from its first frame."""
        args, began_s, station = cast(Record, step.args), round(engine.clock.now(), 6), engine.station
        series = {}
        for dut, gyro in {**station.gyros, **station.off}.items():
            gyro.discard()
            growing = Growing(args.every_s * gyro.data_rate_hz)
            series[dut] = _Series(gyro, growing, gyro.losses, None if dut in station.off else began_s)
        self._open = _Open(step.number, step, args.every_s, began_s, series, engine.clock.now)

    def heard(self, dut: str, batch: FrameBatch) -> None:
        """Add what a DUT sent."""
        if self._open is not None and dut in self._open.series:
            one = self._open.series[dut]
            if one.started_at_s is None and len(batch):
                # The newest frame has just come in; the first began its interval by as much earlier.
                lasted_s = (int(batch.index[-1]) - int(batch.index[0]) + 1) / one.gyro.data_rate_hz
                one.started_at_s = round(max(self._open.started_at_s, self._open.now() - lasted_s), 6)
            self._keep(dut, one.growing.take(batch))

    def disturbed(self, why: str) -> None:
        """Note what happened to the bench meanwhile: the record is no longer what was asked for."""
        if self._open is not None:
            self._open.disturbed.append(why)

    def end(self, engine: Engine) -> None:
        """Write the last parts and say in the journal what there is; durable when this returns."""
        engine.poll()
        record = self._open
        if record is None:  # nobody who lacks it could be heard
            return
        planned = {dut: self._planned(record, one, engine.clock.now()) for dut, one in record.series.items()}
        for dut, one in record.series.items():
            self._keep(dut, one.growing.finish(planned[dut]))
        self._store.flush()
        for dut, one in record.series.items():
            about = self._about(record, dut, one, planned[dut], engine.clock.now())
            engine.log.append("series", engine.clock.now(), about=about)
        self._open = None

    def _planned(self, record: _Open, one: _Series, now_s: float) -> int:
        """Rows from the beginning of a series to now."""
        began_s = record.started_at_s if one.started_at_s is None else one.started_at_s
        return int((now_s - began_s) / record.every_s + 1e-9)

    def _keep(self, dut: str, part: tuple[FrameBatch, Columns] | None) -> None:
        if part is None:
            return
        record = self._open
        assert record is not None
        frames, rows = part
        one = record.series[dut]
        about = self._metadata(record, dut, one)
        self._store.put(RawFile(part_name(record.number, dut, one.growing.parts, "samples"), rows, about))
        if self._frames_too and frames.columns:
            name = part_name(record.number, dut, one.growing.parts, "frames")
            self._store.put(RawFile(name, {"index": frames.index, **frames.columns}, about))

    def _metadata(self, record: _Open, dut: str, one: _Series) -> dict[str, Any]:
        return {
            "record": record.number,
            "label": record.step.record,
            "dut": dut,
            "started_at_s": record.started_at_s if one.started_at_s is None else one.started_at_s,
            "every_s": record.every_s,
            "first_index": one.growing.start,
            "source": one.gyro.describe(),
            "data_rate_hz": one.gyro.data_rate_hz,
            **meaning_as_metadata(one.gyro.meaning),
        }

    def _about(self, record: _Open, dut: str, one: _Series, rows: int, now_s: float) -> dict[str, Any]:
        losses, growing = one.gyro.losses - one.before, one.growing
        verdict, reasons = self._verdict(record, growing, losses, rows)
        return {
            "record": record.number,
            "label": record.step.record,
            "dut": dut,
            "started_at_s": record.started_at_s if one.started_at_s is None else one.started_at_s,
            "ended_at_s": round(now_s, 6),
            "every_s": record.every_s,
            "rows": growing.rows,
            "rows_planned": rows,
            "parts": growing.parts,
            "temperature_degc": record.step.temperature_degc,
            "rate_setpoint_dps": record.step.rate_dps,
            "position_deg": record.step.position_deg,
            "losses": asdict(losses),
            "verdict": verdict,
            "reasons": "; ".join(reasons),
        }

    def _verdict(self, record: _Open, growing: Growing, losses: Losses, rows: int) -> tuple[str, list[str]]:
        """Pass, marginal or fail: from frames lost (the limits of points), rows missing at the end, disturbances."""
        reasons = list(record.disturbed)
        failed = bool(reasons)
        lost_ppm = 1e6 * losses.lost / max(1, losses.lost + growing.received)
        if lost_ppm > self._quality.lost_ppm:
            reasons.append(f"{lost_ppm:.0f} ppm of the frames were lost")
            failed |= lost_ppm > self._quality.fail_at * self._quality.lost_ppm
        # A gyro's own clock may be off by some ppm: the last rows of a long record are not all there.
        missing = rows - growing.rows
        if missing > max(2, 1e-3 * rows):
            reasons.append(f"the last {missing} of {rows} rows are missing")
            failed = True
        return ("fail" if failed else "marginal" if reasons else "pass"), reasons
