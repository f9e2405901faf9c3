"""The virtual bench's instruments at wall speed behind real ptys and a python-can bus, for tests of real ports."""

import contextlib
import os
import threading
import time
import tty
from types import TracebackType

import can
import serial

from simulated_hw.world import World, WorldSpec

TICK_S = 0.004


class LiveBench:
    """Moves a world along the wall clock and pumps bytes between its ports and ptys; CAN gyros send on a channel."""

    def __init__(self, spec: WorldSpec, can_channel: str) -> None:
        self._world = World(spec)
        self._stop = threading.Event()
        self._ports: dict[str, tuple[serial.SerialBase, int]] = {}
        self.ttys: dict[str, str] = {}
        self._world.open()
        addresses = {"chamber": spec.chamber, "rate_table": spec.rate_table, **spec.duts}
        self._buses = []
        for name, instrument in addresses.items():
            if instrument is None:
                continue
            if instrument.address.startswith("can:"):
                far = can.Bus(interface="virtual", channel=can_channel)
                near = can.Bus(interface="fogsim", channel=instrument.address.removeprefix("can:"))
                self._buses.append((near, far))
                continue
            master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(master, False)
            port = serial.serial_for_url(instrument.address, baudrate=instrument.settings["baud"], timeout=0)
            self._ports[name] = port, master
            self.ttys[name] = os.ttyname(slave)
        self._thread = threading.Thread(target=self._pump, daemon=True)
        self._thread.start()

    def _pump(self) -> None:
        began = time.monotonic()
        env = self._world.env
        while not self._stop.wait(TICK_S):
            env.run(until=max(env.now + 1e-6, time.monotonic() - began))
            for port, master in self._ports.values():
                with contextlib.suppress(BlockingIOError):
                    port.write(os.read(master, 4096))
                # a tty that nobody drains loses bytes, as a real one does
                with contextlib.suppress(BlockingIOError):
                    os.write(master, port.read(port.in_waiting))
            for near, far in self._buses:
                while (message := near.recv(0.0)) is not None:
                    far.send(message)

    def unplug(self, name: str) -> None:
        """Take the far end of a port away, as pulling a USB adapter does."""
        port, master = self._ports.pop(name)
        os.close(master)
        port.close()

    def __enter__(self) -> "LiveBench":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        for near, far in self._buses:
            near.shutdown()
            far.shutdown()
        for _, master in self._ports.values():
            os.close(master)
        self._world.close()
