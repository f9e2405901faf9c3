"""Tables that set the run beside the literature, and that say where every number comes from."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence

from bench.report import published
from bench.report.data import HELD_BACK_SPLIT, TRAIN_SPLIT, DutData, ReportData
from bench.report.formats import count, duration, significant, unbroken
from bench.report.residuals import HEADLINE_SPLIT
from bench.report.tables import Cell, Column, Table, table
from bench.report.wording import COLUMNS, model_name

FILES_SHOWN = 24
EVENTS_SHOWN = 60


def published_tables(data: ReportData) -> tuple[Table, Table]:
    """The paper's Table 1 (largest error) and Table 2 (std), our DUTs' figures beside each row."""
    return (
        _beside_published(
            data,
            "max_abs_dps",
            "max",
            "Largest error in °/s: the published Table 1, and the same quantity of this run.",
        ),
        _beside_published(
            data,
            "std_dps",
            "std",
            "Standard deviation of the error in °/s: the published Table 2 (printed there as 'variance'), and the same "
            "quantity of this run.",
        ),
    )


def _beside_published(data: ReportData, quantity: str, prefix: str, caption: str) -> Table:
    columns = [Column("Compensation", numeric=False)] + [Column(label) for label in ("training", "validation")] * (
        1 + len(data.duts)
    )
    rows: list[list[str | Cell]] = []
    for row in published.ROWS:
        printed = [getattr(row, f"{prefix}_train"), getattr(row, f"{prefix}_validation")]
        rows.append([row.label, *printed, *_measured(data.duts, row.model, quantity)])
    for model in _models_beyond(data.duts):
        rows.append([f"{model_name(model)} (fogbench)", "–", "–", *_measured(data.duts, model, quantity)])
    groups = [("", 1), ("published", 2), *((f"DUT {unbroken(dut.name)}", 2) for dut in data.duts)]
    return table(caption, columns, rows, groups)


def _measured(duts: Sequence[DutData], model: str, quantity: str) -> list[str | Cell]:
    return [
        Cell(significant(dut.figure(model, split, quantity), 4))
        for dut in duts
        for split in (TRAIN_SPLIT, HELD_BACK_SPLIT)
    ]


def _models_beyond(duts: Sequence[DutData]) -> list[str]:
    known = {row.model for row in published.ROWS}
    return list(dict.fromkeys(model for dut in duts for model in dut.metrics if model not in known))


def published_notes(data: ReportData) -> list[str]:
    """What a reader must know before comparing the two sides, the run's own numbers filled in."""
    splits = {
        tuple(count(dut.figure("none", split, "n")) for split in (TRAIN_SPLIT, HELD_BACK_SPLIT)) for dut in data.duts
    }
    ours = " and ".join(f"{train} training and {held} held-back points" for train, held in sorted(splits))
    left_out = any(dut.figure("none", HEADLINE_SPLIT, "n") for dut in data.duts)
    instead = " The headline figures above leave whole temperatures out instead." if left_out else ""
    virtual = "a simulated unit" if data.manifest.virtual else "another unit"
    return [
        f"Different gyro: the published figures are of {published.GYRO}; each DUT here is {virtual} with its own error "
        "surface. The columns show scale, not a contest.",
        f"Points: the paper counts {published.POINTS} (18 temperatures × 36 rates, without saying which of the "
        f"19 × 37 = 703 it leaves out), {published.TRAINING_POINTS} for training and {published.VALIDATION_POINTS} for "
        f"validation; this run judged {ours or 'none'}. Both sides of these two tables use a random split: validation "
        "points have neighbours from their own dwell in the training set, so they flatter every model."
        f"{instead}",
        "'Variance': the paper's second figure can only be a standard deviation, because 0.026 read as a variance "
        "would be a standard deviation of 0.16 °/s, larger than the largest error of 0.12 °/s beside it.",
        "The row 'T-S fuzzy model, as published' runs the algorithm as printed (Gustafson–Kessel antecedents, "
        "least-squares consequents, four rules); what it reaches is given as it is, above or below the published "
        "figure. 'T-S joint' optimises antecedents and consequents together and is not in the paper.",
        "'–' means not measured: no such model was fitted in this run, or the paper has no such row.",
    ]


def provenance(data: ReportData) -> list[tuple[str, str]]:
    """Who, what, where and when, as pairs of label and value; pairs without a value are left out."""
    manifest, duts = data.manifest, data.manifest.duts
    versions = ", ".join(f"{name} {version}" for name, version in manifest.versions.items())
    pairs = [
        ("Run", manifest.run_id),
        ("Procedure", _named(manifest.procedure.name, manifest.procedure.file)),
        ("Procedure SHA-256", manifest.procedure.sha256),
        ("Bench", _named(manifest.bench.name, manifest.bench.file)),
        ("Bench SHA-256", manifest.bench.sha256),
        *(
            (f"DUT {name}", _joined(dut.get(key) for key in ("describe", "driver", "port")))
            for name, dut in duts.items()
        ),
        *((name, text) for name, text in manifest.identities.items() if name not in duts),
        ("Seed", "" if manifest.seed is None else str(manifest.seed)),
        ("Overrides", _joined(manifest.overrides)),
        ("Started, ended (UTC)", _joined((manifest.started_utc, manifest.ended_utc))),
        ("Host", manifest.host),
        ("Versions", versions),
        ("Raw files waiting for the disk", _queue_words(manifest.raw_queue)),
        ("Exit code", "" if manifest.exit_code is None else str(manifest.exit_code)),
    ]
    return [(label, value) for label, value in pairs if value]


def _queue_words(queue: Mapping[str, float | None]) -> str:
    """How near the measurement came to waiting for the disk."""
    deepest, length = queue.get("deepest"), queue.get("length")
    return "" if deepest is None or length is None else f"at most {deepest:g} at once, of {length:g} that can"


def _joined(words: Iterable[str | None]) -> str:
    return ", ".join(word for word in words if word)


def _named(name: str, file: str) -> str:
    return f"{name} ({file})" if name and file else name or file


def commands(data: ReportData) -> list[tuple[str, str]]:
    """How to repeat the run, its fit and this report: what it does, and the command."""
    manifest, run = data.manifest, shlex.quote(data.manifest.run_id)
    found = [
        ("fit again from points.csv", f"fogbench fit {run}"),
        ("write this report again", f"fogbench report {run}"),
    ]
    if manifest.procedure.file and manifest.bench.file:
        options = "" if manifest.seed is None else f" --seed {manifest.seed}"
        options += "".join(f" --set {shlex.quote(item)}" for item in manifest.overrides)
        files = f"{shlex.quote(manifest.procedure.file)} --bench {shlex.quote(manifest.bench.file)}"
        found.insert(0, ("repeat the run", f"fogbench run {files}{options}"))
    return found


def files(hashes: Mapping[str, str]) -> Table | None:
    """The files of the run folder with their hashes, folders of many files counted, not listed. None if unknown."""
    if not hashes:
        return None
    inside: dict[str, list[str]] = {}
    for path in sorted(hashes):
        inside.setdefault(path.rpartition("/")[0], []).append(path)
    rows: list[list[str | Cell]] = []
    for folder, paths in inside.items():
        if folder and len(paths) > FILES_SHOWN:
            rows.append([f"{folder}/", f"{count(len(paths))} files; manifest.json has the hash of each"])
        else:
            rows += [[path, Cell(hashes[path], kind="hash")] for path in paths]
    columns = [Column("File", numeric=False), Column("SHA-256", numeric=False)]
    return table("Files of the run folder and their hashes.", columns, rows)


def events(data: ReportData) -> Table | None:
    """What the journal recorded beside points, at most EVENTS_SHOWN; None if nothing."""
    found = data.manifest.events
    if not found:
        return None
    rows = [[duration(event.t_s), event.kind, event.text] for event in found[:EVENTS_SHOWN]]
    more = f" The first {EVENTS_SHOWN} of {count(len(found))} are listed." if len(found) > EVENTS_SHOWN else ""
    columns = [
        Column("Bench time", numeric=False),
        Column("Kind", numeric=False),
        Column("What happened", numeric=False),
    ]
    return table(f"Events of the run.{more}", columns, rows)


def column_glossary() -> Table:
    """What the columns of points.csv mean."""
    columns = [Column("Column of points.csv", numeric=False), Column("Meaning", numeric=False)]
    return table("The columns of points.csv.", columns, [[Cell(name, kind="code"), text] for name, text in COLUMNS])


def started_words(manifest_time: str) -> str:
    """'2026-11-03 08:15 UTC' for an ISO stamp; other text as it is.

    >>> started_words("2026-11-03T08:15:00Z")
    '2026-11-03 08:15 UTC'
    """
    match = re.match(r"(\d{4}-\d{2}-\d{2})T(\d{2}:\d{2})(?::\d{2}(?:\.\d+)?)?(?:Z|\+00:00)$", manifest_time)
    return f"{match[1]} {match[2]} UTC" if match else manifest_time
