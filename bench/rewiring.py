"""A bench with other ports than its file says: those of simulators, for a rehearsal or to be served live."""

from __future__ import annotations

import dataclasses

from bench.benchfile import SIMULATED_CAN, Bench, CanPort, Instrument
from bench.errors import UserMistake
from bench.faultfile import without_faults

# Frames per second of a rehearsed gyro: the engine's waits and the wire are the same, the frames a hundredth.
REHEARSED_RATE_HZ = 1.0


def rehearsed(bench: Bench) -> Bench:
    """The bench with simulated ports instead of its own, slow gyros, and no faults."""
    wired = rewired(bench, "rehearsal")
    duts = {
        serial: dataclasses.replace(item, settings=dataclasses.replace(item.settings, data_rate_hz=REHEARSED_RATE_HZ))
        for serial, item in wired.duts.items()
    }
    return without_faults(dataclasses.replace(wired, duts=duts))


def rewired(bench: Bench, name: str) -> Bench:
    """The bench with a simulated port of its own for every instrument."""

    def wired(item: Instrument) -> Instrument:
        if isinstance(item.port, CanPort):
            channel = f"{name}-{item.name}"
            port: str | CanPort = item.port.model_copy(update={"interface": SIMULATED_CAN, "channel": channel})
        else:
            port = f"sim://{name}-{item.role}-{item.name}".replace(" ", "-")
        # A simulator answers for its kind, not for the instrument on the bench.
        return dataclasses.replace(item, port=port, identity=None)

    duts = {serial: wired(item) for serial, item in bench.duts.items()}
    chamber, table, supply = (item and wired(item) for item in (bench.chamber, bench.rate_table, bench.supply))
    return dataclasses.replace(bench, chamber=chamber, rate_table=table, supply=supply, duts=duts)


def check_identifiers(bench: Bench) -> None:
    """Gyros that are put on one bus need identifiers of their own."""
    taken: dict[int, str] = {}
    for item in bench.duts.values():
        if isinstance(item.port, CanPort) and hasattr(item.driver_class, "can_id"):
            number = item.driver_class.can_id(item.settings)
            other = taken.setdefault(number, item.name)
            if other != item.name:
                raise UserMistake(
                    f"{other} and {item.name} send the same identifier {number & 0x1FFFFFFF:X}; on one bus each needs "
                    "its own (setting can_id). Without --can each gets an adapter of its own."
                )
