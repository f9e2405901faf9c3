"""Which simulated instrument sits at which address: the patch panel between ports and a world.

pyserial and python-can open ports by name, so the table is one per process. A world attaches its instruments when it
opens and detaches them when it closes; importing this module attaches nothing (law 14).
Addresses: 'sim://NAME' for a serial port, 'can:NAME' for a CAN channel.
"""

from typing import Any, Protocol, runtime_checkable

import simpy


class Instrument(Protocol):
    """Anything that can be attached: it lives in a world, and a serial one has a line speed."""

    env: simpy.Environment


@runtime_checkable
class Device(Protocol):
    """A command/reply instrument on a serial line. `baud` is its line speed (8N1)."""

    env: simpy.Environment
    baud: int

    def receive(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """Take bytes that arrived at `now_s`; return (delay_s, reply bytes) for everything it will answer."""
        ...


@runtime_checkable
class Stream(Protocol):
    """An instrument that talks unasked. `baud` is its line speed (8N1)."""

    env: simpy.Environment
    baud: int

    def bytes_until(self, now_s: float) -> bytes:
        """All bytes sent since the last call, up to `now_s`."""
        ...

    def skip_until(self, now_s: float) -> None:
        """Throw away everything sent up to `now_s`, at no cost."""
        ...


@runtime_checkable
class Joinable(Protocol):
    """An instrument that can share its address with others of its kind, as CAN nodes share a bus."""

    def join(self, other: Any) -> None:
        """Let `other` be reached here too. Raises ValueError if the two cannot be told apart."""
        ...


_attached: dict[str, Instrument] = {}


def attach(address: str, instrument: Instrument) -> None:
    """Put an instrument at an address. Raises ValueError if the address is taken and cannot be shared."""
    there = _attached.get(address)
    if isinstance(there, Joinable) and type(there) is type(instrument):
        there.join(instrument)
        return
    if there is not None:
        raise ValueError(f"{address} is taken by another simulated instrument; give each one its own name")
    _attached[address] = instrument


def detach(address: str) -> None:
    """Take the instrument at an address away; no error if there is none (closing twice is harmless)."""
    _attached.pop(address, None)


def find(address: str) -> Instrument:
    """The instrument at an address. Raises LookupError saying what is there instead."""
    try:
        return _attached[address]
    except KeyError:
        there = ", ".join(sorted(_attached)) or "none: no virtual bench is open"
        raise LookupError(f"no simulated instrument at {address}; this world has {there}") from None
