"""The log of faults: one record for frames that follow each other, sums by instrument and fault."""

import json
from pathlib import Path

from simulated_hw.faults.log import FILE, FaultLog, begun


def records(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / FILE).read_text().splitlines()]


def test_frames_that_follow_each_other_are_one_record(tmp_path: Path) -> None:
    log = FaultLog(tmp_path)
    for frame in (5, 6, 7, 9):
        log.add_frames(frame / 100, "A", "loss", 0, frame, frames=1, lost=1)
    log.add_frames(0.1, "B", "loss", 1, 10, frames=1, lost=1)
    assert records(tmp_path) == [
        {"t_s": 0.05, "instrument": "A", "fault": "loss", "number": 0, "frame": 5, "frames": 3, "lost": 3}
    ]
    log.end_run("A")
    log.add_frames(0.1, "A", "loss", 0, 10, frames=2, lost=2)
    log.close()
    log.close()
    written = sorted((record["instrument"], record["frame"], record["lost"]) for record in records(tmp_path))
    assert written == [("A", 5, 3), ("A", 9, 1), ("A", 10, 2), ("B", 10, 1)]
    assert log.totals["A", "loss"]["lost"] == 6 and log.totals["A", "loss"]["events"] == 3


def test_what_began_is_read_from_the_logs_of_earlier_worlds(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for folder, at_s in ((first, 7.0), (second, 9.0)):
        log = FaultLog(folder)
        log.add(at_s, "chamber", "alarm", 0, state="begins")
        log.add(at_s + 1.0, "chamber", "alarm", 0, state="ends")
        log.add_frames(at_s, "A", "loss", 1, 700, frames=1, lost=1)
        log.close()
    with (second / FILE).open("a", encoding="utf-8") as torn:
        torn.write('{"t_s": 1.0, "instrument": "chamber", "fault": "alarm", "number": 0, "sta')
    assert begun([second, first, tmp_path / "none"]) == {(0, "chamber", "alarm"): 7.0}


def test_a_log_without_a_folder_keeps_the_sums() -> None:
    log = FaultLog()
    log.add(1.0, "chamber", "alarm", 0, state="begins")
    log.close()
    assert log.totals["chamber", "alarm"]["events"] == 1
