"""Settings of the tests of the orchestrator."""

import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

from bench.forecast import Forecast

# No test times anything: on a busy machine a single example may take any time.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture
def unrehearsed(monkeypatch: pytest.MonkeyPatch) -> None:
    """New runs begin without a rehearsal, for tests to which it does not matter how long a run would take."""
    monkeypatch.setattr("bench.preparation.rehearse", lambda checked, seed: Forecast((), (), None))


@pytest.fixture(autouse=True, scope="module")
def interrupts() -> Iterator[None]:
    """The command line goes deaf to Ctrl-C when it is over; the process of the tests is not."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)
