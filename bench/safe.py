"""Leaving the bench safe (law 8): table to rest, chamber to its declared safe state, read back and logged.

Runs on every exit: success, failure, Ctrl-C, SIGTERM. An error while making safe is logged and never hides the first.
"""

from __future__ import annotations

from collections.abc import Callable

from bench.benchfile import ChamberSafe, TableSafe
from bench.engine import Engine
from bench.errors import FogbenchError
from drivers.errors import DriverError

NOT_SAFE = "NOT SAFE"
AT_REST_DPS = 0.05
POLL_S = 0.25


def make_safe(engine: Engine) -> list[str]:
    """Bring table and chamber to their safe states. Returns what did not work, in words."""
    failures: list[str] = []
    table, chamber = engine.bench.file.rate_table, engine.bench.file.chamber
    if table and engine.station.table:
        _attempt(engine, "rate table", lambda: _rest(engine, table.safe), failures)
    if chamber and engine.station.chamber:
        _attempt(engine, "chamber", lambda: _calm(engine, chamber.safe), failures)
    try:
        engine.log.commit()
    except OSError as error:
        failures.append(f"journal: {error}")
    return failures


def _attempt(engine: Engine, name: str, action: Callable[[], str], failures: list[str]) -> None:
    try:
        text = action()
    except (DriverError, FogbenchError, OSError) as error:
        text = f"{NOT_SAFE}: {name}: {error}"
        failures.append(text)
    engine.log.append("safe", engine.clock.now(), instrument=name, text=text)


def _rest(engine: Engine, safe: TableSafe) -> str:
    table = engine.station.table
    assert table is not None
    table.stop()
    engine.readbacks.rate_setpoint_dps = 0.0
    deadline = engine.clock.now() + safe.timeout_s
    while abs(rate := table.rate_dps()) > AT_REST_DPS:
        if engine.clock.now() > deadline:
            raise FogbenchError(f"still turning at {rate:g} deg/s {safe.timeout_s:g} s after the stop. Use the E-stop.")
        engine.clock.wait(POLL_S)
    if safe.release:
        table.release()
    return f"at rest, reads {rate:+.4f} deg/s{', drive released' if safe.release else ''}"


def _calm(engine: Engine, safe: ChamberSafe) -> str:
    chamber = engine.station.chamber
    assert chamber is not None
    if safe.action == "hold":
        chamber.set_ramp_degc_min(None)
        setpoint = round(chamber.temperature_degc(), 1) + 0.0
    else:
        chamber.set_ramp_degc_min(safe.rate_degc_min)
        setpoint = safe.temperature_degc
    chamber.set_setpoint_degc(setpoint)
    engine.readbacks.chamber_setpoint_degc = setpoint
    return f"setpoint {chamber.setpoint_degc():g} degC ({safe.action}), reads {chamber.temperature_degc():g} degC"
