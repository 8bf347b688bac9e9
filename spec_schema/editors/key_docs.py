"""Reads the descriptions of keys for editors and the reference page."""

import ast
import inspect
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise

from spec_schema.fields.entry import Entry
from spec_schema.fields.entry_kinds import about, kinds_of

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
    """The line about a key of an entry, "" where there is none: the text below its field.

    Bases speak for what they bring; a key whose value is a mapping is explained by that, unless
    there is more to say.
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
    """The text below each field of each class of a module.

    Only the source has it, so that a command that reads specs pays nothing for it (decision 0196).
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
