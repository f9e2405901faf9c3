"""JSON Schema of procedure and bench files, generated from the same models that check them."""

from __future__ import annotations

import re
from importlib.metadata import entry_points
from typing import Any

from pydantic.json_schema import models_json_schema

from bench.benchfile import DRIVER_GROUPS, BenchFile
from bench.fields import model_of
from bench.procedure.language import SHORT_FORM, VERBS, ProcedureHead

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]
_BOUNDS = {"gt", "ge", "lt", "le", "exclusiveMinimum", "minimum", "exclusiveMaximum", "maximum"}


def procedure_schema() -> Schema:
    """The schema of a procedure file, all verbs included."""
    models = [(model, "validation") for model in (ProcedureHead, *VERBS.values())]
    _, collected = models_json_schema(models, by_alias=True)  # type: ignore[arg-type]
    definitions: Schema = collected["$defs"]
    definitions["Step"] = {"oneOf": [_step(verb, model.__name__) for verb, model in VERBS.items()]}
    for name in ("Sweep", "Repeat", "Record", "ProcedureHead"):
        definitions[name]["properties"]["steps"]["items"] = {"$ref": "#/$defs/Step"}
    head = definitions.pop("ProcedureHead")
    return _tidied({**head, "$schema": DIALECT, "title": "fogbench procedure", "$defs": definitions})


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
    return _tidied({**schema, "$schema": DIALECT, "title": "fogbench bench"})


def _tidied(schema: Schema) -> Schema:
    """The schema with quantities as they are written; pydantic gives bounds and defaults of the number behind them.

    Keys that are no names are refused.
    """
    tidy = {key: _tidied_value(value) for key, value in schema.items()}
    if "patternProperties" in tidy:
        tidy.setdefault("additionalProperties", False)
    if unit := _unit(tidy):
        tidy = {key: value for key, value in tidy.items() if key not in _BOUNDS}
        if isinstance(tidy.get("default"), int | float):
            tidy["default"] = f"{tidy['default']:.12g} {unit}"
    of_items = _unit(tidy["items"]) if isinstance(tidy.get("items"), dict) else None
    if of_items and isinstance(tidy.get("default"), list):
        tidy["default"] = [f"{value:.12g} {of_items}" for value in tidy["default"]]
    return tidy


def _tidied_value(value: Any) -> Any:
    if isinstance(value, list):
        return [_tidied_value(item) for item in value]
    return _tidied(value) if isinstance(value, dict) else value


def _unit(schema: Schema) -> str | None:
    """The unit of a property that is a quantity, or a quantity or null."""
    for choice in (schema, *schema.get("anyOf", ())):
        found = isinstance(choice, dict) and re.search(r"; units: ([^,]+)", str(choice.get("description")))
        if found and choice.get("type") == "string":
            return found[1]
    return None
