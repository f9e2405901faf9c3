"""When a DUT has power: from time 0 on, unless something switches it."""

from bisect import bisect_right
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray


class PowerHistory:
    """The power of one DUT. Commands come in order of time; queries may be of any time from 0 on.

    first_cycle: the number of the turn-on that it runs on at the beginning.
    """

    def __init__(self, first_cycle: int = 0) -> None:
        self._first_cycle = first_cycle
        self.commands_s: list[float] = []
        self._states = [True]

    def switch(self, now_s: float, on: bool) -> None:
        """Switch it on or off; no change is no command. Raises ValueError for a time before the last one."""
        if not (isfinite(now_s) and now_s >= (self.commands_s[-1] if self.commands_s else 0.0)):
            raise ValueError(f"power switched at {now_s} s, which lies before the last time")
        if on != self._states[-1]:
            self.commands_s.append(now_s)
            self._states.append(on)

    def is_on(self, now_s: float) -> bool:
        """Whether it has power at this instant."""
        return self._states[bisect_right(self.commands_s, now_s)]

    def switched_between(self, begin_s: float, end_s: float) -> list[float]:
        """The times after begin_s and before end_s at which it was switched."""
        low, high = bisect_right(self.commands_s, begin_s), bisect_right(self.commands_s, end_s)
        return [at_s for at_s in self.commands_s[low:high] if at_s < end_s]

    def cycles(self, times_s: NDArray[np.float64]) -> NDArray[np.int64]:
        """Which turn-on it runs on then; each power-on counts one."""
        ons = [at_s for at_s, on in zip(self.commands_s, self._states[1:], strict=True) if on]
        return self._first_cycle + np.searchsorted(np.array(ons), times_s, side="right").astype(np.int64)

    def gaps(self, now_s: float) -> list[tuple[float, float]]:
        """All times without power (begin, end) that began by now, in order; the end of one that lasts is infinite."""
        edges = [*self.commands_s, inf]
        pairs = list(zip(edges[::2], edges[1::2], strict=False))
        return [(begin_s, end_s) for begin_s, end_s in pairs if begin_s <= now_s]
