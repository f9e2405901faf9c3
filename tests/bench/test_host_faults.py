"""The host fails: a disk that takes no more writes, a calendar clock that is set, a disk that hangs."""

import errno
import os
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from bench import clock, execution, rawstore
from bench.errors import BenchFailure, Interrupted
from bench.journal import Journal, load_journal
from bench.rawstore import RawStore
from bench.resume import prepare_resume
from bench.run import RunRequest, prepare, run
from tests.bench.campaigns import GRID, VIRTUAL, run_campaign, write
from tests.bench.test_rawstore import raw

READ_ONLY = OSError(errno.EROFS, "Read-only file system")


def refuse(*_: Any) -> Any:
    raise READ_ONLY


def test_results_that_cannot_be_written_refuse_the_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Below what permission bits tell, which mean nothing to root."""
    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(BenchFailure, match=r"the run folder could not be written: .*Read-only.*Nothing was started"):
        run_campaign(tmp_path, "one")
    assert not (tmp_path / "results" / "one").exists()


def test_results_that_become_read_only_end_the_run_safe_and_it_can_be_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = RunRequest(write(tmp_path, "p.yaml", GRID), VIRTUAL, tmp_path / "results", "r")
    left: list[tuple[float, float, list[str]]] = []
    make_safe = execution.make_safe

    def watched(engine: Any) -> list[str]:
        failures = make_safe(engine)
        left.append((engine.station.table.rate_dps(), engine.station.chamber.setpoint_degc(), failures))
        return failures

    def listen(progress: Any) -> None:
        if progress.finished and progress.step.point == 5:
            broken.setattr(os, "fsync", refuse)
            broken.setattr(Journal, "_hand_over", refuse)

    monkeypatch.setattr(execution, "make_safe", watched)
    with pytest.MonkeyPatch.context() as broken, pytest.raises(BenchFailure) as failure:
        run(prepare(request), listen)
    assert "Read-only file system" in str(failure.value) and "fogbench resume" in str(failure.value)
    ((rate_dps, setpoint_degc, failures),) = left
    assert abs(rate_dps) < 0.05 and setpoint_degc == 25.0
    # the journal alone did not work
    assert len(failures) == 1 and failures[0].startswith("journal: ")
    end = run(prepare_resume(tmp_path / "results" / "r"))
    assert end.outcome == "PASS", end.message
    assert len(pd.read_csv(end.folder / "points.csv")) == 56


def test_a_journal_goes_on_where_a_full_disk_cut_a_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal.create(tmp_path / "j", {"run_id": "r"})
    journal.append("note", 1.0, text="before")
    file, whole = journal._file, journal._file.write

    class Full:
        """Takes seven bytes, then none; what else is asked goes to the file."""

        left = 7

        def write(self, data: bytes) -> int:
            if not self.left:
                raise OSError(errno.ENOSPC, "No space left on device")
            self.left, taken = 0, self.left
            return whole(data[:taken])

        def fileno(self) -> int:
            return file.fileno()

    monkeypatch.setattr(journal, "_file", Full())
    journal.append("note", 2.0, text="cut")
    journal.append("note", 3.0, text="after")
    with pytest.raises(OSError, match="No space left"):
        journal.commit()
    assert [entry["t_s"] for entry in load_journal(tmp_path / "j")] == [0.0, 1.0]
    monkeypatch.setattr(journal, "_file", file)
    journal.close()
    assert [entry["t_s"] for entry in load_journal(tmp_path / "j")] == [0.0, 1.0, 2.0, 3.0]


def test_a_record_is_with_the_system_before_it_is_committed(tmp_path: Path) -> None:
    """A killed process loses none: the file is read while it is open and uncommitted."""
    journal = Journal.create(tmp_path / "j", {})
    journal.append("readback", 1.0)
    assert [entry["kind"] for entry in load_journal(tmp_path / "j")] == ["journal", "readback"]
    journal.close()


class Stepped:
    """A calendar that is put forward and back by hours each time it is asked."""

    def __init__(self) -> None:
        self.asked = 0

    def off(self) -> timedelta:
        self.asked += 1
        return timedelta(hours=5.0 if self.asked % 2 else -7.0)

    def now(self, zone: Any) -> datetime:
        return datetime.now(UTC) + self.off()


def test_a_calendar_that_is_set_moves_no_bench_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = run_campaign(tmp_path, "honest")
    stepped, time = Stepped(), clock.time.time
    monkeypatch.setattr(clock, "datetime", stepped)
    monkeypatch.setattr(clock.time, "time", lambda: time() + stepped.off().total_seconds())
    wall = clock.WallClock()
    before_s = wall.now()
    wall.wait(0.01)
    assert 0.01 <= wall.now() - before_s < 3600.0
    end = run_campaign(tmp_path, "stepped")
    assert stepped.asked >= 2 and end.outcome == "PASS"
    assert (end.folder / "points.csv").read_bytes() == (honest.folder / "points.csv").read_bytes()


def test_a_gap_is_never_negative(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_text("")
    later = path.stat().st_mtime + 7 * 3600.0
    os.utime(path, (later, later))
    assert clock.seconds_since_changed(path) == 0.0


def test_a_request_to_stop_ends_the_wait_for_a_disk_that_hangs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hangs, stop = threading.Event(), clock.StopRequest()
    monkeypatch.setattr(rawstore, "write_parquet", lambda *_: hangs.wait(60.0))
    store = RawStore(tmp_path / "raw", stop.look)
    store.put(raw(0))
    stop.ask()
    with pytest.raises(Interrupted):
        store.flush()
    # while the bench is made safe nothing interrupts; afterwards only a hurry does
    stop.forget()
    stop.look()
    stop.safe = True
    stop.look()
    stop.hurry()
    with pytest.raises(Interrupted):
        store.close()
    hangs.set()
