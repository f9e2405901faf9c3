"""Ports that are opened without a run process: who is there is asked first, and only who is known is commanded."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from bench.benchfile import Bench, load_bench
from bench.clock import Clock
from bench.composition import open_bench
from bench.errors import BenchFailure
from bench.opening import open_commanded, open_known
from bench.station import Station
from tests.bench.campaigns import VIRTUAL

CHAMBER, TABLE = "Watlow F4, model 5270", "Acutronic USA, ACT3000, simulated"


@pytest.fixture
def opened() -> Iterator[tuple[Bench, Station, Clock]]:
    """A bench whose ports were open and are shut again."""
    bench, problems = load_bench(VIRTUAL)
    assert bench is not None, problems
    with open_bench(bench, 1, None) as (station, clock):
        station.close()
        yield bench, station, clock


def test_who_the_run_began_with_is_opened(opened: tuple[Bench, Station, Clock]) -> None:
    bench, first, clock = opened
    station, failures = open_commanded(bench, clock, first.identities)
    assert failures == [] and station.chamber and station.table
    assert station.identities == first.identities


@pytest.mark.parametrize(
    ("name", "was", "found"), [("chamber", "Watlow F4, model 1", CHAMBER), ("rate table", "Ideal", TABLE)]
)
def test_another_instrument_than_the_run_began_with_is_told_and_shut(
    opened: tuple[Bench, Station, Clock], name: str, was: str, found: str
) -> None:
    bench, first, clock = opened
    station, (failure,) = open_commanded(bench, clock, {**first.identities, name: was})
    assert f"where '{was}' was, '{found}' answers now; it was not commanded" in failure
    assert list(station.closers) == [{"chamber": "rate table", "rate table": "chamber"}[name]]
    assert (station.chamber is None, station.table is None) == (name == "chamber", name == "rate table")


def test_of_an_instrument_nobody_heard_of_the_bench_file_decides(opened: tuple[Bench, Station, Clock]) -> None:
    bench, _, clock = opened
    assert bench.chamber is not None
    station, failures = open_commanded(bench, clock, {})
    assert failures == [] and station.identities["chamber"] == CHAMBER
    station.close()
    strict = replace(bench.chamber, identity="Watlow F4, model 1*")
    with pytest.raises(BenchFailure, match="expects 'Watlow F4, model 1\\*'"):
        open_known(Station(), strict, clock)
