"""Generates the JSON Schema of specs, which editors use to complete and check them."""

import ast
import inspect
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from inspect import isclass
from itertools import pairwise
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from spec_schema.fields.entry import Entry, LateEntry, OneOf, about, kinds_of, kinds_within
from spec_schema.fields.leaf import Gathering, JsonSchema, LeafField
from spec_schema.sections.spec import Spec

# What a key means wherever it stands, unless there is more to say below its field.
_EVERYWHERE: Mapping[str, str] = {
    "bias": "Whether a learned constant is added.",
    "dims": "Named dimensions of the value, in order.",
    "doc": "What it is, for people and for generated code.",
    "out": "Dimension of the result; a scalar by default.",
    "prefix": "What generated names start with; by default the name of the spec.",
    "substeps": "Steps of the integrator a sample.",
    "unit": "Unit of measurement such as `m/s`; checked where both sides declare one.",
}


def key_doc(entry: type[Entry], key: str) -> str:
    """The description of a key of an entry for editors: the text below its field; "" if there is
    none.

    Inherited keys have that of the base class. A key whose value is a mapping has that of the
    mapping's class, unless its own field has a text.
    """
    fields = ((field.alias or name, name, field) for name, field in entry.model_fields.items())
    ((name, field),) = ((name, field) for k, name, field in fields if k == key)
    if field.description:
        return field.description  # a section of a feature, from the registry
    # the nearest class that says something about the key
    for kind in entry.__mro__:
        if issubclass(kind, Entry) and name in (
            found := _field_docs(kind.__module__)[kind.__name__]
        ):
            return found[name]
    if key in _EVERYWHERE:
        return _EVERYWHERE[key]
    return about(kinds[0]) if (kinds := kinds_of(field.annotation)) else ""


@cache
def _field_docs(module: str) -> Mapping[str, Mapping[str, str]]:
    """The text below each field, by class and field of a module.

    It is read from the source, so that commands that only read specs spend no time on it (decision
    0196).
    """
    classes = ast.parse(inspect.getsource(sys.modules[module])).body
    return {
        node.name: dict(_texts_below(node.body))
        for node in classes
        if isinstance(node, ast.ClassDef)
    }


def _texts_below(body: Sequence[ast.stmt]) -> Iterator[tuple[str, str]]:
    for field, below in pairwise(body):
        match field, below:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str() as text)),
            ):
                yield name, " ".join(text.split())
            case _:
                pass


# Draft 7 is what the YAML extension of VS Code supports best.
_DRAFT = "http://json-schema.org/draft-07/schema#"
_FOREIGN: JsonSchema = {"^x-": {}}


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a whole spec, with one definition per class of mappings.

    It has neither `oneOf` nor `anyOf`: a shorthand is one more type, so that an editor always knows
    which keys can follow.
    """
    kinds = list(kinds_within(Spec))
    return {
        "$schema": _DRAFT,
        "title": "msnn spec",
        **_definition(Spec),
        "definitions": {kind.__name__: _definition(kind) for kind in kinds[1:]},
    }


def json_schema_text() -> str:
    """The JSON Schema as the text of a file; the same bytes each time."""
    return json.dumps(json_schema(), ensure_ascii=False, indent=1) + "\n"


def _definition(entry: type[Entry]) -> dict[str, Any]:
    """The schema of a mapping, which also admits the scalar or list that may replace it."""
    required = [key for key, _, needed in _fields(entry) if needed]
    # a section whose entries are commented out is null, and legal
    types = ["object"] if required or issubclass(entry, OneOf) else ["object", "null"]
    mapping: dict[str, Any] = {
        "type": types,
        "description": about(entry),
        "properties": {key: _property(entry, key, schema) for key, schema, _ in _fields(entry)}
        | {key: _reserved(entry, key) for key in sorted(entry.later)},
        "patternProperties": _FOREIGN,
        "additionalProperties": False,
    }
    if required:
        mapping["required"] = required
    if issubclass(entry, OneOf):
        mapping["minProperties"] = 1
    return _united(mapping, _alone(entry))


def _fields(entry: type[Entry]) -> Iterator[tuple[str, JsonSchema, bool]]:
    for name, field in entry.model_fields.items():
        # the reader adds the place, and an optimizer where a stage has none
        if name != "place":
            schema = _schema(field.annotation, field.metadata)
            yield field.alias or name, schema, field.is_required() and name != "optimizer"


def _property(entry: type[Entry], key: str, schema: JsonSchema) -> dict[str, Any]:
    described = {**schema, "description": key_doc(entry, key)}
    default = _defaults(entry)[key]
    return {**described, "default": default} if default is not None else described


def _defaults(entry: type[Entry]) -> dict[str, bool | float | str | None]:
    """The scalar default of each key; None for lists, mappings and keys without default."""
    defaults: dict[str, bool | float | str | None] = {}
    for name, field in entry.model_fields.items():
        plain = isinstance(field.default, bool | int | float | str)
        defaults[field.alias or name] = field.default if plain else None
    return defaults


def _reserved(entry: type[Entry], key: str) -> dict[str, Any]:
    said = f"`{key}` in {entry.noun} is planned, not in this version of msnn."
    # `not: {}` refuses every value, with words of its own in editors that have them
    return {"description": said, "errorMessage": said, "doNotSuggest": True, "not": {}}


def _alone(entry: type[Entry]) -> JsonSchema:
    """The forms that replace the mapping: its shorthand, or the bare name of a variant."""
    if entry.shorthand is not None:
        schemas = {key: schema for key, schema, _ in _fields(entry)}
        return _inlined(schemas[entry.shorthand], entry)
    if not issubclass(entry, OneOf):
        return {"type": []}
    values = {key: schema for key, schema, _ in _fields(entry)}
    if "value" in values:
        # the initial value of a parameter: a lone expression is its variant `value`
        return values["value"]
    return {
        "type": ["string"],
        "pattern": f"^({'|'.join(values)})$",
        "examples": list(values),
    }


def _inlined(schema: JsonSchema, entry: type[Entry]) -> JsonSchema:
    """The schema without `$ref`: the forms of the mapping that it refers to, except the mapping
    itself.
    """
    if "$ref" not in schema:
        return schema
    (kind,) = (
        kind
        for field in entry.model_fields.values()
        for kind in kinds_of(field.annotation)
        if _reference(kind) == schema["$ref"]
    )
    alone = dict(_alone(kind))
    alone["type"] = [type for type in _types(alone) if type != "object"]
    return {key: value for key, value in alone.items() if key not in _OF_OBJECTS}


_OF_OBJECTS = {"properties", "additionalProperties", "required"}


def _united(mapping: dict[str, Any], alone: JsonSchema) -> dict[str, Any]:
    """One schema that admits a mapping and the forms that may replace it."""
    types = [*mapping["type"], *(t for t in _types(alone) if t not in mapping["type"])]
    properties = {**alone.get("properties", {}), **mapping["properties"]}
    kept = {key: value for key, value in alone.items() if key not in _OF_OBJECTS}
    # an enumeration would have to list every mapping too
    words = kept.pop("enum", None)
    if words is not None:
        kept |= {"pattern": f"^({'|'.join(words)})$", "examples": words}
    shown = types[0] if len(types) == 1 else types
    return {**kept, **mapping, "type": shown, "properties": properties}


def _types(schema: JsonSchema) -> list[str]:
    types = schema.get("type", [])
    return [types] if isinstance(types, str) else list(types)


def _schema(annotation: Any, metadata: list[Any]) -> JsonSchema:
    for note in metadata:
        if isinstance(note, LeafField):
            return note.schema
        if isinstance(note, Gathering):
            return note.schema(_item(annotation))
        if isinstance(note, LateEntry):
            return {"$ref": _reference(note.kind)}
    if isclass(annotation) and issubclass(annotation, Entry):
        return {"$ref": _reference(annotation)}
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _schema(arguments[0], list(arguments[1:]))
    assert origin in (Union, UnionType), f"{annotation} has no schema"
    (only,) = (argument for argument in arguments if argument is not NoneType)
    return _schema(only, [])


def _item(annotation: Any) -> JsonSchema:
    """The schema of the items of `tuple[Item, ...]`, or of the values of `Mapping[str, Item]`."""
    arguments = [part for part in get_args(annotation) if part not in (str, ...)]
    return _schema(arguments[0], [])


def _reference(kind: type[Entry]) -> str:
    return f"#/definitions/{kind.__name__}"
