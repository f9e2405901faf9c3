"""From YAML mappings to typed values: pydantic models whose keys are field names without their unit suffix.

A field `data_rate_hz: float` is written `data_rate: 100 Hz`. The same rule turns the frozen dataclasses that drivers
and simulators declare for their settings into models, so that a new instrument needs no code here to be checked and
documented.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import types
import typing
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, Union

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    create_model,
)
from pydantic_core import CoreSchema, core_schema

from bench.errors import Problem
from bench.mistakes import keys_of, problems_of, sentence
from bench.units import DIMENSIONS, parse_quantity, split_suffix
from bench.yamlfile import Document, Path_

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Model = TypeVar("Model", bound=BaseModel)
Settings = TypeVar("Settings", bound="DataclassInstance")


def yaml_key(field: str) -> str:
    """The YAML key of a field: without unit suffix, and without the underscore that avoids a Python keyword.

    >>> yaml_key("to_degc"), yaml_key("for_s"), yaml_key("from_dps"), yaml_key("order")
    ('to', 'for', 'from', 'order')
    """
    return split_suffix(field)[0].rstrip("_")


@dataclasses.dataclass(frozen=True)
class Quantity:
    """Annotation of a float that YAML writes as a number with a unit of the dimension `suffix`."""

    suffix: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(
            lambda value: parse_quantity(value, self.suffix), handler(source)
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        dimension = DIMENSIONS[self.suffix]
        units = ", ".join(dimension.factors)
        return {"type": "string", "description": f"{dimension.name}; units: {units}", "examples": [dimension.example]}


class YamlMapping(BaseModel):
    """Base of every YAML mapping: unknown keys are mistakes, values are not coerced."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, alias_generator=yaml_key, arbitrary_types_allowed=True
    )


@functools.cache
def model_of(declared: type) -> type[BaseModel]:
    """The model of a settings dataclass, its quantities recognised by the suffix of the field name."""
    hints = typing.get_type_hints(declared)
    fields: dict[str, Any] = {}
    for item in dataclasses.fields(declared):
        default: Any = ...
        if item.default is not dataclasses.MISSING:
            default = item.default
        elif item.default_factory is not dataclasses.MISSING:
            default = Field(default_factory=item.default_factory)
        fields[item.name] = (_field_type(hints[item.name], split_suffix(item.name)[1]), default)
    return create_model(declared.__name__, __base__=YamlMapping, __doc__=declared.__doc__, **fields)


def _field_type(hint: Any, suffix: str | None) -> Any:
    if hint is float and suffix:
        return Annotated[float, Quantity(suffix)]
    if hint is float:
        return Annotated[float, Field(allow_inf_nan=False)]
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return model_of(hint)
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (Union, types.UnionType):
        return Union[tuple(_field_type(arg, suffix) for arg in args)]  # noqa: UP007 - built at run time
    if origin is tuple:
        return list.__class_getitem__(_field_type(args[0], suffix))
    return hint


def to_dataclass(declared: type, values: BaseModel) -> Any:
    """The dataclass instance that a model of `model_of(declared)` describes. Raises ValueError from its own checks."""
    hints = typing.get_type_hints(declared)
    converted = {
        item.name: _convert(hints[item.name], getattr(values, item.name)) for item in dataclasses.fields(declared)
    }
    return declared(**converted)


def _convert(hint: Any, value: Any) -> Any:
    if isinstance(value, BaseModel):
        candidates = [c for c in (hint, *typing.get_args(hint)) if isinstance(c, type) and dataclasses.is_dataclass(c)]
        return to_dataclass(next(c for c in candidates if c.__name__ == type(value).__name__), value)
    return tuple(value) if isinstance(value, list) else value


def validate(model: type[Model], document: Document, path: Path_, problems: list[Problem]) -> Model | None:
    """Validate the value at `path` of a document; mistakes go to `problems`, each with its place."""
    data = document.data
    for part in path:
        data = data[part]
    if not isinstance(data, dict):
        allowed = ", ".join(keys_of(model))
        problems.append(Problem(document.mark(path), f"a mapping is expected here. Allowed keys: {allowed}."))
        return None
    try:
        return model.model_validate(data)
    except ValidationError as error:
        problems.extend(problems_of(model, document, path, error.errors(include_url=False)))
        return None


def validate_dataclass(declared: type, document: Document, path: Path_, problems: list[Problem]) -> Any | None:
    """Validate the mapping at `path` as a settings dataclass; None and problems if it is not one."""
    values = validate(model_of(declared), document, path, problems)
    if values is None:
        return None
    try:
        return to_dataclass(declared, values)
    except ValueError as error:
        problems.append(refused(document, path, str(error)))
        return None


def changed(preset: Settings, values: BaseModel) -> Settings:
    """A settings dataclass with the fields that were written replaced, nested ones field by field."""
    changes: dict[str, Any] = {}
    for name in values.model_fields_set:
        value = getattr(values, name)
        if isinstance(value, BaseModel):
            changes[name] = changed(getattr(preset, name), value)
        else:
            changes[name] = tuple(value) if isinstance(value, list) else value
    return dataclasses.replace(preset, **changes)


def refused(document: Document, path: Path_, text: str) -> Problem:
    """A settings class's own objection to the mapping at `path`, at the key it is about.

    It begins with that key, or with Class.field_unit = …, where the class may be one nested in the mapping.
    """
    field = re.match(r"[A-Z]\w+\.(\w+) = ", text)
    key = yaml_key(field[1]) if field else text.partition(" ")[0].rstrip(":")
    text = f"{key} = {text[field.end() :]}" if field else text
    place = (*path, *key.split("."))
    nested = (item for item in document.values if item[: len(path)] == path and item[-1:] == (key,))
    return Problem(document.mark(place if place in document.values else next(nested, place)), sentence(text))
