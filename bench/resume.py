"""Take a run up again that was paused and ended, aborted, failed, or died: what must hold before it may go on."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path

from bench.check import Checked, check
from bench.clock import seconds_since_changed
from bench.errors import UserMistake
from bench.forecast import rehearse
from bench.journal import Entry, load_journal
from bench.manifest import sha256
from bench.overrides import Override, parse_overrides
from bench.refit import complete
from bench.resumption import interruption_of
from bench.run import Prepared, Resumed, record_files
from bench.runfolder import DECLARATIONS, INCLUDED

KINDS = ("procedure", "bench")


def prepare_resume(folder: Path, accept: Sequence[str] = ()) -> Prepared:
    """Check and rehearse what is left of a run. Raises UserMistake; touches no hardware.

    `accept` names the files ('procedure', 'bench') whose changes since the run began are wanted.
    """
    entries = load_journal(folder / "journal.jsonl")
    end = next((entry for entry in reversed(entries) if entry["kind"] in ("end", "resumed")), None)
    if end is not None and end["kind"] == "end" and end["failure"] is None:
        # It may have died between its last record and its last file.
        complete(folder)
        raise UserMistake(
            f"the run '{folder.name}' finished; there is nothing to resume. See: fogbench report {folder}"
        )
    overrides = parse_overrides(entries[0].get("overrides", []))
    included = sorted((folder / INCLUDED).glob("*"))
    recorded = check(folder / "procedure.yaml", folder / "bench.yaml", overrides, included, folder / DECLARATIONS)
    stop = interruption_of(entries)
    checked, accepted = _with_changes(folder, entries[0], recorded, overrides, stop.next_step, accept)
    bench = checked.bench
    gap_s = 0.0 if bench.virtual else seconds_since_changed(folder / "journal.jsonl") * bench.file.clock.speed
    attempt = 2 + sum(entry["kind"] == "resumed" for entry in entries)
    seed = int(entries[0]["seed"])
    resumed = Resumed(stop, gap_s, attempt, accepted)
    return Prepared(folder, checked, seed, rehearse(checked, seed), overrides, resumed)


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
