"""The acquire verb: record the frames of every DUT for the planned samples and reduce them to one point each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, cast

import numpy as np

from bench.engine import Engine
from bench.points import point_row
from bench.procedure.language import Acquire, Quality
from bench.procedure.plan import PlannedStep
from bench.rawstore import RawFile
from bench.reduction import Samples, point_statistics, to_samples
from bench.station import Gyro
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
        if last == len(frames.index):
            return frames
        columns = {name: values[:last] for name, values in frames.columns.items()}
        return FrameBatch(
            columns, frames.index[:last], frames.rate_dps[:last], frames.temperature_degc[:last], frames.good[:last]
        )


class RecordingAcquirer:
    """Records, reduces and keeps: frames to the raw store, one row per DUT to the log."""

    def __init__(
        self,
        quality: Quality,
        earth_rate_dps: float,
        raw_mode: RawMode = "none",
        store: Callable[[RawFile], None] = lambda raw: None,
    ) -> None:
        self._quality = quality
        self._earth_rate_dps = earth_rate_dps
        self._raw_mode = raw_mode
        self._store = store

    def acquire(self, engine: Engine, step: PlannedStep) -> None:
        args = cast(Acquire, step.args)
        recordings = self._begin(engine, args)
        began_s = engine.clock.now()
        chamber, rates = self._record(engine, args, recordings)
        ended_s = engine.clock.now()
        for dut, recording in recordings.items():
            frames = recording.frames()
            samples = to_samples(
                frames.index - (recording.start or 0),
                frames.rate_dps,
                frames.temperature_degc,
                frames.good,
                recording.frames_per_sample,
                recording.count,
                newest=args.take == "newest",
            )
            row = point_row(
                step=step,
                dut=dut,
                statistics=point_statistics(samples, args.every_s),
                planned_samples=recording.count,
                planned_frames=recording.needed,
                frames=frames,
                losses=recording.gyro.losses - recording.before,
                chamber_degc=_mean(chamber),
                rate_dps=_mean(rates),
                earth_rate_dps=self._earth_rate_dps,
                started_at_s=began_s,
                ended_at_s=ended_s,
                quality=self._quality,
            )
            engine.log.append("point", ended_s, row=row)
            self._keep_raw(step, dut, recording, frames, samples, began_s, args)

    def _begin(self, engine: Engine, args: Acquire) -> dict[str, _Recording]:
        recordings = {}
        for dut, gyro in engine.station.gyros.items():
            gyro.discard()
            recordings[dut] = _Recording(gyro, args.every_s * gyro.data_rate_hz, args.samples, gyro.losses)
        return recordings

    def _record(
        self, engine: Engine, args: Acquire, recordings: dict[str, _Recording]
    ) -> tuple[list[float], list[float]]:
        """Listen until every DUT has sent what is needed or is overdue; the readbacks taken meanwhile."""
        chamber: list[float] = []
        rates: list[float] = []
        end = engine.clock.now() + args.duration_s
        deadline = end + args.duration_s * CLOCK_TOLERANCE + LATE_S
        while (now := engine.clock.now()) < deadline and not all(r.complete for r in recordings.values()):
            # Once the planned time is over only the last frames are on their way.
            engine.clock.wait(min(SLICE_S, end - now) if end - now > 1e-6 else 0.02)
            for dut, recording in recordings.items():
                engine.heard(dut, recording.gyro, recording.take())
            if now < end:
                readbacks = engine.read_instruments()
                chamber += [readbacks.chamber_degc] if readbacks.chamber_degc is not None else []
                rates += [readbacks.rate_dps] if readbacks.rate_dps is not None else []
        return chamber, rates

    def _keep_raw(
        self,
        step: PlannedStep,
        dut: str,
        recording: _Recording,
        frames: FrameBatch,
        samples: Samples,
        began_s: float,
        args: Acquire,
    ) -> None:
        if self._raw_mode == "none" or not frames.columns:
            return
        columns: dict[str, Any]
        if self._raw_mode == "frames":
            columns = {"index": frames.index, **frames.columns}
        else:
            columns = asdict(samples)
        metadata = {
            "point": step.point,
            "dut": dut,
            "started_at_s": began_s,
            "every_s": args.every_s,
            "take": args.take,
            "source": recording.gyro.describe(),
            "data_rate_hz": recording.gyro.data_rate_hz,
            "quantities": {name: asdict(law) for name, law in recording.gyro.quantities.items()},
        }
        self._store(RawFile(f"p{step.point:05d}-{dut}.parquet", columns, metadata))


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None
