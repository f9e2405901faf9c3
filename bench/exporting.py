"""Models of a run, or of a file, written for other programs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.errors import UserMistake, did_you_mean
from bench.runfolder import find_run, write_atomic
from fitting.export.c99 import export_c
from fitting.export.coefficients import coefficients_csv
from fitting.export.compiled import object_bytes
from fitting.export.form import Operations
from fitting.export.forms import NotExported
from fitting.export.precision import PRECISIONS
from fitting.export.text import identifier
from fitting.modelfile import Compensation, ModelFileError, load_model


@dataclass(frozen=True)
class Source:
    """A model file and whose it is."""

    path: Path
    dut: str
    model: str


@dataclass(frozen=True)
class Cost:
    """What a model costs in C; rounding: most that its self-test allows, in `unit`."""

    coefficients: int
    coefficient_bytes: int
    object_bytes: int | None
    operations: Operations
    rounding: float
    unit: str


@dataclass(frozen=True)
class Written:
    """One model: the main file written, what it costs in C, or why it was refused."""

    dut: str
    model: str
    path: Path | None
    cost: Cost | None
    refused: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return dataclasses.asdict(self)


def models_of(run: str | None, dut: str | None, model: str | None, results: Path) -> list[Source]:
    """The model files of a run, of one gyro or all, of one model or all. Raises UserMistake if there is none."""
    if run is None:
        raise UserMistake("export what? Give a RUN (a run folder or run id; see: fogbench list) or --file MODEL.json")
    folder = find_run(run, results) / "models"
    duts = sorted(path.name for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []
    if not duts:
        raise UserMistake(f"{folder}: this run has no models. Fit some: fogbench fit {run} --model ts_joint")
    if dut is not None and dut not in duts:
        raise UserMistake(f"{folder}: there is no DUT '{dut}' in this run.{did_you_mean(dut, duts)}")
    found = [
        Source(path, name, path.stem)
        for name in ([dut] if dut else duts)
        for path in sorted((folder / name).glob("*.json"))
    ]
    chosen = [source for source in found if model is None or source.model == model]
    if not chosen:
        names = sorted({source.model for source in found})
        raise UserMistake(f"{folder}: there is no model '{model}' in this run.{did_you_mean(model or '', names)}")
    return chosen


def one_model(run: str | None, path: Path) -> list[Source]:
    """A model file of its own. Raises UserMistake if a run is named as well."""
    if run is not None:
        raise UserMistake(f"both a run ('{run}') and --file {path} are given; give one of them.")
    meta = load(path).document["meta"]
    dut = meta.get("dut")
    return [Source(path, dut if isinstance(dut, str) else "", path.stem)]


def the_model(model: str, dut: str | None, name: str | None, results: Path) -> Path:
    """The file of one model: a model file, or of a run the only one that `dut` and `name` leave. Raises UserMistake."""
    if Path(model).is_file():
        if dut is not None or name is not None:
            raise UserMistake(f"{model} is a model file; --dut and --model are for runs.")
        return Path(model)
    if Path(model).suffix == ".json":
        raise UserMistake(f"{model}: there is no such model file.")
    found = models_of(model, dut, name, results)
    if len(found) > 1:
        listed = ", ".join(f"--dut {one.dut} --model {one.model}" for one in found)
        raise UserMistake(f"the run '{model}' has {len(found)} models; say which one: {listed}")
    return found[0].path


def load(path: Path) -> Compensation:
    """Read a model file. Raises UserMistake with the reason."""
    try:
        return load_model(path)
    except ModelFileError as error:
        raise UserMistake(str(error)) from error


def write_model(source: Source, target: str, precision: str, folder: Path, strict: bool) -> Written:
    """Write one model as 'c', 'csv' or 'json' into a folder.

    Raises UserMistake if the file is damaged, or if its form is not exported and `strict`.
    """
    compensation = load(source.path)
    name = identifier(source.dut, source.model)
    cost, refused, files = None, None, dict[str, str]()
    try:
        exported = export_c(compensation, name, PRECISIONS[precision])
        compiled = object_bytes(exported.files, exported.source)
        cost = Cost(
            exported.coefficients,
            exported.coefficient_bytes,
            compiled,
            exported.operations,
            exported.largest_rounding,
            compensation.output.unit,
        )
        files = exported.files if target == "c" else {f"{name}.csv": coefficients_csv(compensation)}
    except NotExported as error:
        refused = str(error)
        if strict and target != "json":
            raise UserMistake(f"{source.path}: {error}") from error
    if target == "json":
        files = {f"{name}.json": source.path.read_text(encoding="utf-8")}
    return Written(source.dut, source.model, _write(files, folder, source.path), cost, refused)


def _write(files: Mapping[str, str], folder: Path, source: Path) -> Path | None:
    """Write the files; the last of them is the one to name. The model file itself is left alone."""
    path = None
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        path = folder / name
        if not (path.exists() and path.samefile(source)):
            write_atomic(path, text.encode())
    return path
