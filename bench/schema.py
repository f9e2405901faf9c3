"""JSON Schema of procedure and bench files, generated from the same models that check them."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from pydantic.json_schema import models_json_schema

from bench.benchfile import DRIVER_GROUPS, BenchFile
from bench.fields import model_of
from bench.procedure.language import SHORT_FORM, VERBS, ProcedureHead

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]


def procedure_schema() -> Schema:
    """The schema of a procedure file, all verbs included."""
    models = [(model, "validation") for model in (ProcedureHead, *VERBS.values())]
    _, collected = models_json_schema(models, by_alias=True)  # type: ignore[arg-type]
    definitions: Schema = collected["$defs"]
    definitions["Step"] = {"oneOf": [_step(verb, model.__name__) for verb, model in VERBS.items()]}
    for name in ("Sweep", "Repeat", "ProcedureHead"):
        definitions[name]["properties"]["steps"]["items"] = {"$ref": "#/$defs/Step"}
    head = definitions.pop("ProcedureHead")
    return {"$schema": DIALECT, "title": "fogbench procedure", **head, "$defs": definitions}


def _step(verb: str, model: str) -> Schema:
    arguments: Schema = {"$ref": f"#/$defs/{model}"}
    if verb in SHORT_FORM:
        arguments = {
            "anyOf": [{"type": ["string", "number"], "description": f"short for {SHORT_FORM[verb]}"}, arguments]
        }
    return {"type": "object", "properties": {verb: arguments}, "required": [verb], "additionalProperties": False}


def bench_schema() -> Schema:
    """The schema of a bench file; the settings of every installed driver stand under its name."""
    schema = BenchFile.model_json_schema(by_alias=True)
    definitions: Schema = schema.setdefault("$defs", {})
    for group in DRIVER_GROUPS.values():
        for point in entry_points(group=group):
            settings = model_of(point.load().Settings).model_json_schema(by_alias=True)
            definitions |= settings.pop("$defs", {})
            definitions[f"settings of {point.name}"] = settings
    return {"$schema": DIALECT, "title": "fogbench bench", **schema}
