"""Live simulators in the test's own process, by the names of the instruments; CAN gyros send on a 'virtual' channel."""

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any

from simulated_hw import live
from simulated_hw.wire import switchboard
from simulated_hw.world import WorldSpec


class LiveBench:
    """`simulated_hw.live.LiveBench`, served by a thread while the context lasts."""

    def __init__(self, spec: WorldSpec, can_channel: str) -> None:
        self._served = ExitStack()
        # The system gives the number of a pty that went to the next one: whoever still looks for the first must not
        # find the second. A link goes with its pty.
        links = Path(self._served.enter_context(TemporaryDirectory()))
        self._live = live.LiveBench(spec, live.LiveOptions(can=("virtual", can_channel), links=links))
        named = {"chamber": spec.chamber, "rate_table": spec.rate_table, "supply": spec.supply, **spec.duts}
        self._addresses = {name: instrument.address for name, instrument in named.items() if instrument}
        self.ttys: dict[str, str] = {}

    def table_rate_dps(self) -> float:
        """True rate of the table now."""
        world = self._live.world
        return float(world.table.true_rate_dps(world.env.now))

    def unplug(self, name: str) -> None:
        """Take the far end of a port away, as pulling a USB adapter does."""
        self._live.unplug(self._addresses[name])

    def replug(self, name: str) -> None:
        """Put it in again, under the same name."""
        self._live.plug(self._addresses[name])

    def tell(self, name: str, data: bytes) -> None:
        """Have an instrument hear these bytes from somebody else, as its front panel would have it do something."""
        instrument: Any = switchboard.find(self._addresses[name])
        instrument.receive(data, self._live.world.env.now)

    def __enter__(self) -> "LiveBench":
        self._served.enter_context(self._live)
        self._served.enter_context(self._live.in_background())
        opened = self._live.addresses
        self.ttys = {name: str(opened[address]) for name, address in self._addresses.items()}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._served.close()
