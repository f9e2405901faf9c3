"""Progress of a run: one moving line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys

import click

from bench.clock import stopwatch
from bench.engine import Progress, Readbacks
from bench.run import Prepared
from bench.units import format_duration

REDRAW_S = 0.1


class ProgressPrinter:
    """Listener of the engine that knows the forecast and so the ETA."""

    def __init__(self, prepared: Prepared, quiet: bool) -> None:
        self._prepared = prepared
        self._quiet = quiet
        self._moving = sys.stderr.isatty()
        self._drawn = 0.0
        self._began = stopwatch()
        self._step = 0
        self._step_began_s = 0.0
        self._dwell = 0
        self._measured = 0

    def begin(self) -> None:
        """Say what is about to happen."""
        checked, forecast = self._prepared.checked, self._prepared.forecast
        kind = "VIRTUAL bench" if checked.bench.virtual else "bench"
        self._line(
            f"{checked.head.procedure} on {kind} {checked.bench.file.bench}: {checked.content} of "
            f"{len(checked.bench.duts)} DUTs, {format_duration(forecast.duration_s)} by rehearsal"
        )
        for text in [*forecast.warnings, *([forecast.failure] if forecast.failure else [])]:
            self._line(f"warning from the rehearsal: {text}")
        self._began = stopwatch()

    def end(self) -> None:
        """Finish the moving line."""
        if self._moving and not self._quiet:
            click.echo("\r\x1b[K", err=True, nl=False)

    def tell(self, progress: Progress) -> None:
        """Draw progress, not more often than the eye needs."""
        if progress.step.number != self._step:
            self._step, self._step_began_s = progress.step.number, progress.t_s
        if progress.finished and progress.step.point is not None:
            self._measured = progress.step.point
        if self._quiet:
            return
        if self._moving:
            if stopwatch() - self._drawn >= REDRAW_S:
                self._drawn = stopwatch()
                click.echo("\r\x1b[K" + self._text(progress)[:160], err=True, nl=False)
        elif progress.step.dwell != self._dwell or (not self._virtual and progress.finished and progress.step.point):
            self._dwell = progress.step.dwell
            self._line(self._text(progress))

    @property
    def _virtual(self) -> bool:
        return self._prepared.checked.bench.virtual

    def _text(self, progress: Progress) -> str:
        step = progress.step
        remaining = self._prepared.forecast.remaining_s(step.number, progress.t_s - self._step_began_s)
        wall = ""
        if self._virtual and progress.t_s > self._prepared.forecast.duration_s / 100:
            wall = f" ({(stopwatch() - self._began) / progress.t_s * remaining:.0f} s)"
        planned = self._prepared.checked.points
        return (
            f"{format_duration(progress.t_s):>16}  point {self._measured}/{planned}  {step.verb:<16} "
            f"{_readbacks(progress.readbacks)}  ETA {format_duration(remaining)}{wall}"
        )

    def _line(self, text: str) -> None:
        if not self._quiet:
            click.echo(text, err=True)


def _readbacks(now: Readbacks) -> str:
    parts = []
    if now.chamber_degc is not None:
        setpoint = "" if now.chamber_setpoint_degc is None else f"/{now.chamber_setpoint_degc:g}"
        parts.append(f"chamber {now.chamber_degc:.1f}{setpoint} degC")
    if now.rate_dps is not None:
        setpoint = "" if now.rate_setpoint_dps is None else f"/{now.rate_setpoint_dps:g}"
        parts.append(f"table {now.rate_dps:.3f}{setpoint} deg/s")
    parts += [f"{dut} {degc:.2f} degC" for dut, degc in now.dut_degc.items()]
    return "  ".join(parts)
