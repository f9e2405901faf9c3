"""Metrics, models and manifest: made again from the points with the same functions, and compared."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.analyses.models import INPUT_COLUMNS, judge_limits, model_factories
from bench.conclude import ANALYSES, conclude, failure_of
from bench.errors import UserMistake
from bench.manifest import sha256
from bench.points import usable
from bench.procedure.analyses import Analysis
from bench.verify.findings import Check, Finding, attempt, collect
from bench.verify.record import JOURNAL, Record, whole_bytes
from bench.verify.tables import read_table
from fitting.modelfile import load_model
from fitting.strict_json import read_object
from fitting.training import TrainingRecord
from fitting.validation import UNCOMPENSATED

# A fit on another processor or with another linear algebra library differs in its last digits; what is on disk is
# held to the last bit by the hashes of the manifest.
RELATIVE = 1e-6
METRICS, MANIFEST, RESIDUALS = "metrics.json", "manifest.json", "residuals.parquet"


@dataclass(frozen=True)
class Again:
    """What the run's end gives when it is made again: metrics, manifest, and the names of the model files."""

    metrics: Mapping[str, Any]
    manifest: Mapping[str, Any]
    models: Sequence[str]
    documents: Mapping[str, Any]


def check_results(record: Record) -> list[Check]:
    """Metrics and residuals, models, manifest."""
    in_metrics: list[Finding] = []
    in_models: list[Finding] = []
    in_manifest: list[Finding] = []
    folder = record.folder
    manifest = attempt(in_manifest, MANIFEST, read_object, folder / MANIFEST) or {}
    metrics: dict[str, Any] = {}
    if (folder / METRICS).exists() or (record.head and record.head.analysis):
        metrics = attempt(in_metrics, METRICS, read_object, folder / METRICS) or {}
    again = attempt(in_metrics, METRICS, _again, record, metrics, in_metrics)
    collect(in_manifest, MANIFEST, _hashes, folder, manifest)
    if again is not None:
        collect(in_metrics, METRICS, _metrics, again.metrics, metrics)
        for name, document in again.documents.items():
            collect(in_metrics, f"{ANALYSES}/{name}", _document, folder, name, document)
        if metrics:
            collect(in_metrics, RESIDUALS, _residuals, record, metrics)
        if manifest:
            collect(in_manifest, MANIFEST, _manifest, record, again, manifest, metrics)
    names = _model_files(folder)
    for name in sorted({*names, *(again.models if again else ())}):
        collect(in_models, name, _model, record, name, metrics)
    return [
        Check("metrics", f"{_count(metrics)} fits made again", in_metrics),
        Check("models", f"{len(names)} model files applied to the points", in_models),
        Check("manifest", f"{len(manifest.get('files', ()))} hashes; outcome {manifest.get('outcome')}", in_manifest),
    ]


def _count(metrics: Mapping[str, Any]) -> int:
    return sum(
        len([m for m in models if m != UNCOMPENSATED]) for models in metrics.values() if isinstance(models, dict)
    )


def _model_files(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.glob("models/*/*.json"))


def _again(record: Record, metrics: Mapping[str, Any], findings: list[Finding]) -> Again | None:
    """Conclude the journal in another folder, with the models that are on disk."""
    if record.head is None:
        return None
    analysis = record.head.analysis
    extra = _extra_models(analysis, metrics, findings)
    with tempfile.TemporaryDirectory(prefix="fogbench-verify-") as name:
        folder = Path(name)
        (folder / JOURNAL).write_bytes((record.folder / JOURNAL).read_bytes()[: whole_bytes(record)])
        end = conclude(folder, record.head, failure_of(record.entries), recorded=record.folder)
        if extra:
            end = conclude(folder, record.head, failure_of(record.entries), models=extra, recorded=record.folder)
        documents = {path.name: read_object(path) for path in sorted((folder / ANALYSES).glob("*.json"))}
        return Again(end.metrics, end.manifest, _model_files(folder), documents)


def _extra_models(analysis: Analysis | None, metrics: Mapping[str, Any], findings: list[Finding]) -> list[str]:
    """Models that were fitted besides those of the procedure, as far as they are installed here."""
    fitted = [name for models in metrics.values() for name in models if name != UNCOMPENSATED]
    extra = []
    for name in dict.fromkeys(fitted):
        if analysis is not None and name in analysis.models:
            continue
        try:
            model_factories([name])
        except UserMistake:
            findings.append(
                Finding(f"model '{name}' is not installed here: not fitted again", METRICS, severity="note")
            )
        else:
            extra.append(name)
    return extra


def _metrics(expected: Mapping[str, Any], found: Mapping[str, Any]) -> Iterator[Finding]:
    """Figures that are not what the points give. Time of a fit is the clock's, and left out."""
    wanted, got = dict(_flat(expected)), dict(_flat(found))
    missing_here = {path[:2] for path in got} - {path[:2] for path in wanted}
    for path in [*wanted, *(path for path in got if path not in wanted)]:
        if path[-1] == "fit_s" and path in got:
            continue
        if path not in wanted and path[:2] in missing_here and len(path) == 4:
            continue  # of a model that is not installed here: noted
        if path not in got or path not in wanted or not _close(wanted[path], got[path]):
            where = " / ".join(map(str, path))
            yield Finding(
                f"{where} is not what the points give",
                METRICS,
                dut=str(path[0]),
                figure=where,
                expected=_plain(wanted.get(path)),
                found=_plain(got.get(path)),
            )


def _document(folder: Path, name: str, expected: Mapping[str, Any]) -> Iterator[Finding]:
    """Figures of another analysis that are not what the record gives; how long a fit took is nobody's to repeat."""
    wanted, got = dict(_leaves(expected)), dict(_leaves(read_object(folder / ANALYSES / name)))
    for path in sorted({*wanted, *got}):
        if path[-1] != "fit_s" and (path not in got or path not in wanted or not _close(wanted[path], got[path])):
            where = " / ".join(path)
            text = f"{where} is not what the record gives"
            found = _plain(got.get(path))
            yield Finding(text, f"{ANALYSES}/{name}", None, None, where, _plain(wanted.get(path)), found)


def _leaves(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every number, text and truth of a document, by its path."""
    inside: Any = ()
    if isinstance(value, Mapping):
        inside = value.items()
    elif isinstance(value, list):
        inside = enumerate(value)
    else:
        yield path, value
    for key, inner in inside:
        yield from _leaves(inner, (*path, str(key)))


def _flat(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if isinstance(value, Mapping) and len(path) < 4:
        for key, inner in value.items():
            yield from _flat(inner, (*path, str(key)))
    else:
        yield path, value


def _close(expected: Any, found: Any) -> bool:
    if isinstance(expected, float) and isinstance(found, int | float) and not isinstance(found, bool):
        return bool(np.isclose(found, expected, rtol=RELATIVE, atol=0.0, equal_nan=True))
    return type(expected) is type(found) and bool(expected == found)


def _plain(value: Any) -> str | int | float | None:
    return value if value is None or isinstance(value, str | int | float) else str(value)


def _residuals(record: Record, metrics: Mapping[str, Any]) -> Iterator[Finding]:
    """Whether the errors kept give the figures of the metrics."""
    most = len(record.points) * (1 + _count(metrics)) * 3
    table = read_table(record.folder / RESIDUALS, most)
    given = {key: rows["residual_dps"].to_numpy() for key, rows in table.groupby(["dut", "model", "split"])}
    for dut, models in metrics.items():
        for model, splits in models.items():
            for split, figures in splits.items():
                errors = given.pop((dut, model, split), np.empty(0))
                found = _figures(errors)
                for name, value in found.items():
                    if not _close(figures.get(name), value):
                        text = f"{dut} / {model} / {split} / {name} of its errors is not that of {METRICS}"
                        yield Finding(text, RESIDUALS, None, dut, name, _plain(figures.get(name)), _plain(value))
    for key in given:
        yield Finding(f"has errors of {' / '.join(map(str, key))}, which {METRICS} has not", RESIDUALS)


def _figures(errors: np.ndarray[Any, Any]) -> dict[str, float | int]:
    if not errors.size:
        return {"n": 0}
    return {"n": len(errors), "max_abs_dps": float(np.abs(errors).max()), "std_dps": float(errors.std())}


def _model(record: Record, name: str, metrics: Mapping[str, Any]) -> Iterator[Finding]:
    """Whether a model is of these points and does on them what it states."""
    dut, model = Path(name).parent.name, Path(name).stem
    loaded = load_model(record.folder / name)
    document = loaded.document
    if model not in metrics.get(dut, {}):
        yield Finding(f"{METRICS} knows no fit of it", name, dut=dut)
    about = {"dut": dut, "model": model, "run_id": record.entries[0]["run_id"]}
    figures = metrics.get(dut, {}).get(model, {})
    pairs: list[tuple[str, Any, Any]] = [
        (f"meta.{key}", value, document["meta"].get(key)) for key, value in about.items()
    ]
    stated = document["figures_of_merit"]
    pairs += [(f"figures_of_merit.{split}", value, stated.get(split)) for split, value in figures.items()]
    inputs, target = _training(record, dut, document["meta"]["inputs"])
    training = TrainingRecord.of(inputs, target, loaded.predict(inputs[:, 0], inputs[:, 1]))
    pairs += [
        ("training.sha256", training.sha256, document["training"]["sha256"]),
        ("training.rows", training.rows, document["training"]["rows"]),
        ("training_max_abs_dps", training.max_abs_residual, stated.get("training_max_abs_dps")),
        ("training_std_dps", training.std_residual, stated.get("training_std_dps")),
        ("input ranges", training.input_min.tolist(), loaded.input_min.tolist()),
        ("input ranges", training.input_max.tolist(), loaded.input_max.tolist()),
    ]
    for figure, expected, found in pairs:
        if not _close(expected, found):
            text = f"its {figure} is not what points and {METRICS} give"
            yield Finding(text, name, None, dut, figure, _plain(expected), _plain(found))


def _training(record: Record, dut: str, inputs: Sequence[str]) -> tuple[Any, Any]:
    table = usable(record.points, dut)
    columns = table[[INPUT_COLUMNS[name] for name in inputs]].to_numpy(dtype=np.float64)
    return columns, table["rate_reference_dps"].to_numpy(dtype=np.float64)


def _hashes(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Files that are not those the manifest was written for."""
    for name, expected in manifest.get("files", {}).items():
        path = folder / name
        found = sha256(path) if path.resolve().is_relative_to(folder.resolve()) and path.is_file() else ""
        if found != expected:
            text = "is not the file the manifest was written for" if found else "is missing or cannot be read"
            yield Finding(text, name, None, None, "sha256", _plain(expected), found)


def _manifest(
    record: Record, again: Again, manifest: Mapping[str, Any], metrics: Mapping[str, Any]
) -> Iterator[Finding]:
    """Statements that do not follow from journal and metrics."""
    duts = list(record.entries[0]["duts"])
    analysis = record.head.analysis if record.head else None
    judged = judge_limits(analysis, dict(metrics), duts) if analysis else []
    # Those of the points from the metrics on disk, which may be of a fit after the run; then those of other analyses.
    limits = [{**asdict(item), "passed": item.passed} for item in judged] + again.manifest["limits"][len(judged) :]
    expected = dict(again.manifest) | {"limits": limits}
    for key in ("files", "notes"):
        wanted, got = expected.pop(key), manifest.get(key)
        if not _fits(key, wanted, got):
            yield Finding(f"its {key} are others", MANIFEST, None, None, key, _listed(wanted), _listed(got))
    if manifest.get("notes") != again.manifest["notes"]:
        expected.pop("message")  # names the notes of the last fit
    for key, value in expected.items():
        if _json(value) != manifest.get(key):
            text = f"its '{key}' does not follow from the journal"
            yield Finding(text, MANIFEST, None, None, key, _plain(_json(value)), _plain(manifest.get(key)))
    for key in sorted(set(manifest) - set(again.manifest)):
        yield Finding(f"has '{key}', which does not follow from the journal", MANIFEST)


def _fits(key: str, expected: Any, found: Any) -> bool:
    """The same files have a hash; every note is one that fitting gives (fitting one model later gives fewer)."""
    if key == "files":
        return isinstance(found, dict) and set(expected) <= set(found) | {"procedure.yaml", "bench.yaml"}
    return isinstance(found, list) and all(note in expected for note in found)


def _listed(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, dict | list) else str(value)


def _json(value: Any) -> Any:
    """As it reads back from JSON."""
    if isinstance(value, Mapping):
        return {str(key): _json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return int(value) if isinstance(value, int) and not isinstance(value, bool) else value
