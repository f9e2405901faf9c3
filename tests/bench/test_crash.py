"""Kill -9 anywhere, resume, lose nothing: a few trials here, the many of `python3 do.py crash` with the campaigns."""

from pathlib import Path

import pytest

from tests.crash import Tally, after, at_record, trial


def test_a_few_kills_at_records_and_at_random_instants(tmp_path: Path) -> None:
    tally = Tally()
    trial(tmp_path, [at_record(14, torn=True), after(0.05), at_record(3, torn=False), at_record(25, torn=True)], tally)
    assert tally.kills >= 3 and tally.clean, str(tally)


@pytest.mark.campaign
def test_a_kill_at_every_record_of_a_campaign(tmp_path: Path) -> None:
    tally, number = Tally(), 1
    while True:
        folder = tmp_path / str(number)
        folder.mkdir()
        before = tally.kills
        trial(folder, [at_record(number, torn=False)], tally)
        assert tally.clean, f"killed at record {number}: {tally}"
        if tally.kills == before:
            break  # it ended before it got that far
        number += 1
    assert {"step", "done", "point", "readback", "safe", "note", "identities", "forecast"} <= set(tally.by_kind)
