"""Take a run up again that was paused and ended, aborted, failed, or died: what must hold before it may go on."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bench.attempt import record_files
from bench.benchfile import Bench
from bench.check import Checked, check
from bench.clock import seconds_since_changed
from bench.dutlinks import left_out
from bench.errors import UserMistake
from bench.forecast import Forecast, rehearse
from bench.journal import Entry, load_journal
from bench.manifest import missing_points, planned, sha256
from bench.missing import Missing, missing_of, steps_for
from bench.overrides import Override, parse_overrides
from bench.preparation import Prepared, Resumed
from bench.refit import complete
from bench.resumption import interruption_of, off_before
from bench.runfolder import DECLARATIONS, INCLUDED
from bench.series import finished_series

KINDS = ("procedure", "bench")


def prepare_resume(
    folder: Path, accept: Sequence[str] = (), missing: bool = False, after_s: float | None = None
) -> Prepared:
    """Check and rehearse what is left of a run. Raises UserMistake; touches no hardware.

    `accept` names the files ('procedure', 'bench') whose changes since the run began are wanted. With `missing`, what
    is left is what a run whose plan was carried out did not measure, or measured badly. `after_s` is how long a virtual
    bench stood meanwhile: its time goes on only when it is said to.
    """
    entries = load_journal(folder / "journal.jsonl")
    _check_finished(folder, entries, missing)
    overrides = parse_overrides(entries[0].get("overrides", []))
    included = sorted((folder / INCLUDED).glob("*"))
    recorded = check(folder / "procedure.yaml", folder / "bench.yaml", overrides, included, folder / DECLARATIONS)
    stop = interruption_of(entries)
    checked, accepted = _with_changes(folder, entries[0], recorded, overrides, stop.next_step, accept)
    bench = checked.bench
    gap_s = _gap_s(folder, bench, after_s)
    attempt = 2 + sum(entry["kind"] == "resumed" for entry in entries)
    seed = int(entries[0]["seed"])
    absent = left_out(entries)
    if not missing:
        resumed = Resumed(stop, gap_s, attempt, accepted, None, absent, off_before(checked.plan, stop.next_step))
        return Prepared(folder, checked, seed, rehearse(checked, seed), overrides, resumed)
    lacking = missing_of(entries, checked.plan)
    resumed = Resumed(stop, gap_s, attempt, accepted, lacking, absent)
    return Prepared(folder, checked, seed, _forecast(checked, seed, lacking), overrides, resumed)


def _gap_s(folder: Path, bench: Bench, after_s: float | None) -> float:
    """Bench time since the run stopped: by the wall, or on a virtual bench as stated. UserMistake for a real one."""
    if bench.virtual:
        return after_s or 0.0
    if after_s is not None:
        raise UserMistake("--after is for a virtual bench; on a real one the time that has passed has passed.")
    return seconds_since_changed(folder / "journal.jsonl") * bench.file.clock.speed


def _check_finished(folder: Path, entries: Sequence[Entry], missing: bool) -> None:
    """Raise UserMistake if there is nothing to go on with, or if it is to be asked for in another way."""
    ends = [entry for entry in entries if entry["kind"] == "end"]
    carried_out = any(end["failure"] is None for end in ends)
    if not carried_out:
        if missing:
            raise UserMistake(f"the plan of run '{folder.name}' was not carried out yet: fogbench resume {folder}")
        return
    last = next(entry for entry in reversed(entries) if entry["kind"] in ("end", "resumed"))
    ended = last["kind"] == "end" and last["failure"] is None
    if ended:
        # It may have died between its last record and its last file.
        complete(folder)
    if missing and not (ended and not _lacks(entries)):
        return
    finished = f"the run '{folder.name}' finished; there is nothing to resume. See: fogbench report {folder}"
    if _lacks(entries) or not ended:
        finished += f". What it lacks is measured by: fogbench resume {folder} --missing"
    raise UserMistake(finished)


def _lacks(entries: Sequence[Entry]) -> bool:
    """Whether points or records are missing or failed."""
    records = planned(entries, "records_planned") * len(entries[0]["duts"])
    made = sum(one["verdict"] != "fail" for one in finished_series(entries))
    return bool(missing_points(entries)) or made < records


def _forecast(checked: Checked, seed: int, missing: Missing) -> Forecast:
    """The rehearsal of what is missing; a step that is left out ends with the one before it."""
    steps = steps_for(checked.plan, missing)
    rehearsed = rehearse(replace(checked, plan=steps), seed)
    ends = dict(zip((step.number for step in steps), rehearsed.ends_s, strict=False))
    ends_s: list[float] = []
    for step in checked.plan if ends else ():
        ends_s.append(ends.get(step.number, ends_s[-1] if ends_s else 0.0))
    return replace(rehearsed, ends_s=tuple(ends_s))


def _with_changes(
    folder: Path,
    head: Entry,
    recorded: Checked,
    overrides: Sequence[Override],
    done: int,
    accept: Sequence[str],
) -> tuple[Checked, str]:
    """What to run: as recorded, or with the changes that are accepted by name; and a text about them."""
    changed = [kind for kind in KINDS if _changed(folder, head, kind)]
    refused = [kind for kind in changed if kind not in accept]
    if refused:
        raise UserMistake(_refusal(folder, head, refused))
    if not changed:
        return recorded, ""
    paths = {kind: Path(head[kind]["file"]) if kind in changed else folder / f"{kind}.yaml" for kind in KINDS}
    included = () if "procedure" in changed else recorded.procedure.included
    now = check(
        paths["procedure"], paths["bench"], overrides, included, None if "bench" in changed else folder / DECLARATIONS
    )
    _check_untouched(recorded, now, done)
    record_files(folder, now, changed)
    return now, f"; accepted changes of the {' and the '.join(changed)} file"


def _changed(folder: Path, head: Entry, kind: str) -> bool:
    """Whether the file a run was started from is there and differs from the copy in the run folder."""
    now = sha256(Path(head[kind]["file"]))
    return bool(now) and now != sha256(folder / f"{kind}.yaml")


def _refusal(folder: Path, head: Entry, kinds: Sequence[str]) -> str:
    parts: list[str] = []
    for kind in kinds:
        before = (folder / f"{kind}.yaml").read_text(encoding="utf-8").splitlines()
        after = Path(head[kind]["file"]).read_text(encoding="utf-8", errors="replace").splitlines()
        parts += difflib.unified_diff(before, after, "as run", head[kind]["file"], lineterm="")
    options = " ".join(f"--accept {kind}" for kind in kinds)
    return (
        f"the {' and the '.join(kinds)} file changed since the run began:\n" + "\n".join(parts) + "\n"
        f"Undo the change, or accept it by name if only steps not yet run change: fogbench resume {folder} {options}"
    )


def _check_untouched(recorded: Checked, now: Checked, done: int) -> None:
    """Raise UserMistake if a change touches what has been run: finished steps, the DUTs, the site."""
    for before, after in zip(recorded.plan[:done], [*now.plan[:done], *[None] * done], strict=False):
        if after is None or (before.verb, before.args) != (after.verb, after.args):
            place = f" (now {after.mark})" if after else ""
            raise UserMistake(
                f"{before.mark}: step {before.number} '{before.verb}' has been run and would be another{place}. Only "
                "steps not yet run may change; start a new run for the rest."
            )
    if list(recorded.bench.duts) != list(now.bench.duts) or recorded.bench.file.site != now.bench.file.site:
        raise UserMistake("the DUTs or the site of the bench file changed; the points of one run are of one bench.")
