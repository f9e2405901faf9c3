"""The acquire verb: record the frames of every DUT for the planned samples and reduce them to one point each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, cast

import numpy as np

from bench.engine import Engine
from bench.instruments import Gyro
from bench.noise import NoiseHistory
from bench.points import Figures, Row, point_row
from bench.procedure.conditions import Quality
from bench.procedure.language import Acquire
from bench.procedure.plan import PlannedStep
from bench.rawstore import RawFile, RawStore, meaning_as_metadata
from bench.reduction import Samples, point_statistics, spikes, to_samples
from drivers.codecs.batch import FrameBatch
from drivers.codecs.counters import Losses

# Readbacks during an acquisition, and the block in which frames are decoded: large enough for whole numpy batches,
# small enough to stay in a core's cache.
SLICE_S = 60.0
# A gyro's own clock may be this much slower than the host's before its frames are missed rather than late.
CLOCK_TOLERANCE = 2e-3
LATE_S = 2.0

RawMode = Literal["frames", "samples", "none"]


class RehearsedAcquirer:
    """Lets an acquisition take its time without frames: for dry runs."""

    def acquire(self, engine: Engine, step: PlannedStep) -> None:
        engine.clock.wait(cast(Acquire, step.args).duration_s)
        engine.poll()


@dataclass
class _Recording:
    """The frames of one DUT during one acquisition."""

    gyro: Gyro
    frames_per_sample: float
    count: int
    before: Losses
    batches: list[FrameBatch] = field(default_factory=list)
    start: int | None = None

    @property
    def needed(self) -> int:
        return math.ceil(self.count * self.frames_per_sample - 1e-9)

    @property
    def complete(self) -> bool:
        return self.start is not None and int(self.batches[-1].index[-1]) - self.start >= self.needed - 1

    def take(self) -> FrameBatch:
        batch = self.gyro.take()
        if len(batch.index):
            if self.start is None:
                self.start = int(batch.index[0])
            self.batches.append(batch)
        return batch

    def frames(self) -> FrameBatch:
        """All frames that belong to the acquisition."""
        frames = FrameBatch.concat(self.batches)
        last = int(np.searchsorted(frames.index, (self.start or 0) + self.needed))
        return frames if last == len(frames.index) else frames.head(last)


@dataclass
class _Heard:
    """What one acquisition listened to: the DUTs that were there to its end, and the readbacks taken meanwhile."""

    recordings: dict[str, _Recording]
    began_s: float
    ended_at_s: float = 0.0
    chamber_degc: list[float] = field(default_factory=list)
    rates_dps: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class _Measured:
    """One DUT's point, reduced, and what it was made of."""

    dut: str
    recording: _Recording
    frames: FrameBatch
    samples: Samples
    row: Row


class RecordingAcquirer:
    """Records, reduces and keeps: frames to the raw store, one row per DUT to the log."""

    def __init__(
        self,
        quality: Quality,
        earth_rate_dps: float,
        raw_mode: RawMode = "none",
        store: RawStore | None = None,
    ) -> None:
        self._quality = quality
        self._earth_rate_dps = earth_rate_dps
        self._raw_mode = raw_mode
        self._store = store
        self._given_up: set[str] = set()
        self._noise = NoiseHistory()

    def remember(self, rows: Sequence[Row], plan: Sequence[PlannedStep]) -> None:
        """Go on behind the finished rows of a journal."""
        measured = sorted(rows, key=lambda row: float(row["started_at_s"]))
        self._noise.fold(measured, plan)
        newest = {row["dut"]: row["verdict"] for row in measured}
        self._given_up = {dut for dut, verdict in newest.items() if verdict == "fail"}

    def acquire(self, engine: Engine, step: PlannedStep) -> None:
        """Measure a point of every DUT; again, if one failed that is still there and has not been given up."""
        for repeat in range(self._quality.repeats + 1):
            measured = self._measure(engine, step)
            bad = {item.dut: item.row["reasons"] for item in measured if item.row["verdict"] == "fail"}
            engine.tend_links(engine)
            if repeat == self._quality.repeats or not (bad.keys() & engine.station.gyros.keys()) - self._given_up:
                break
            text = f"point {step.point} is measured again: {'; '.join(f'{dut} {why}' for dut, why in bad.items())}"
            engine.log.append("warning", engine.clock.now(), step=step.number, text=text)
        # A DUT that stayed bad is not waited for again until it has given a good point.
        self._given_up = set(bad)
        for item in measured:
            engine.log.append("point", engine.clock.now(), row=item.row)
            self._noise.add(item.row, cast(Acquire, step.args))
            self._keep_raw(step, item)
        if self._store:
            self._store.flush()

    def _measure(self, engine: Engine, step: PlannedStep) -> list[_Measured]:
        args = cast(Acquire, step.args)
        heard = self._record(engine, args, self._begin(engine, args))
        return [self._reduced(step, dut, recording, heard) for dut, recording in heard.recordings.items()]

    def _reduced(self, step: PlannedStep, dut: str, recording: _Recording, heard: _Heard) -> _Measured:
        args, quality = cast(Acquire, step.args), self._quality
        frames = recording.frames()
        spiked = spikes(frames.rate_dps, frames.good)
        samples = to_samples(
            frames.index - (recording.start or 0),
            frames.rate_dps,
            frames.temperature_degc,
            frames.good if spiked is None else frames.good & ~spiked,
            recording.frames_per_sample,
            recording.count,
            newest=args.take == "newest",
        )
        figures = Figures(
            planned_samples=recording.count,
            planned_frames=recording.needed,
            frames=frames,
            losses=recording.gyro.losses - recording.before,
            spikes=0 if spiked is None else int(np.count_nonzero(spiked)),
            chamber_degc=heard.chamber_degc,
            rates_dps=heard.rates_dps,
            typical_std_dps=self._noise.typical_dps(dut, step.rate_dps, args, quality.noise_history),
            started_at_s=heard.began_s,
            ended_at_s=heard.ended_at_s,
        )
        statistics = point_statistics(samples, args.every_s)
        row = point_row(step, dut, statistics, figures, self._earth_rate_dps, quality)
        return _Measured(dut, recording, frames, samples, row)

    def _begin(self, engine: Engine, args: Acquire) -> dict[str, _Recording]:
        recordings = {}
        for dut, gyro in engine.station.gyros.items():
            gyro.discard()
            recordings[dut] = _Recording(gyro, args.every_s * gyro.data_rate_hz, args.samples, gyro.losses)
        return recordings

    def _record(self, engine: Engine, args: Acquire, recordings: dict[str, _Recording]) -> _Heard:
        """Listen until every DUT has sent what is needed or is overdue."""
        heard = _Heard(recordings, engine.clock.now())
        end = heard.began_s + args.duration_s
        deadline = end + args.duration_s * CLOCK_TOLERANCE + LATE_S
        while (now := engine.clock.now()) < deadline and not all(r.complete for r in recordings.values()):
            # Once the planned time is over only the last frames are on their way.
            engine.clock.wait(min(SLICE_S, end - now) if end - now > 1e-6 else 0.02)
            for dut, recording in recordings.items():
                engine.heard(dut, recording.gyro, recording.take())
            if now < end:
                self._read(engine, heard)
        heard.ended_at_s = engine.clock.now()
        return heard

    def _read(self, engine: Engine, heard: _Heard) -> None:
        """Take readbacks, those alone that were read now; and go on without a DUT that a guard dropped meanwhile."""
        now = engine.read_instruments()
        if now.chamber_degc is not None and now.chamber_s == now.t_s:
            heard.chamber_degc.append(now.chamber_degc)
        if now.rate_dps is not None and now.rate_s == now.t_s:
            heard.rates_dps.append(now.rate_dps)
        for dut in heard.recordings.keys() - engine.station.gyros.keys():
            del heard.recordings[dut]

    def _keep_raw(self, step: PlannedStep, item: _Measured) -> None:
        args, frames, recording = cast(Acquire, step.args), item.frames, item.recording
        if self._store is None or self._raw_mode == "none" or not frames.columns:
            return
        columns: dict[str, Any]
        if self._raw_mode == "frames":
            columns = {"index": frames.index, **frames.columns}
        else:
            columns = asdict(item.samples)
        metadata = {
            "point": step.point,
            "dut": item.dut,
            "started_at_s": item.row["started_at_s"],
            "every_s": args.every_s,
            "samples": recording.count,
            "take": args.take,
            "source": recording.gyro.describe(),
            "data_rate_hz": recording.gyro.data_rate_hz,
            **meaning_as_metadata(recording.gyro.meaning),
        }
        self._store.put(RawFile(f"p{step.point:05d}-{item.dut}.parquet", columns, metadata))
