"""Mappings whose keys the user chooses: names, names of other things, and patterns of names."""

from collections.abc import Mapping
from typing import Annotated, TypeAlias, TypeVar

from pydantic import ValidationInfo

from spec_schema.errors import schema as errors
from spec_schema.fields.entry import RefusedError, findings_of
from spec_schema.fields.leaf import Gathering, any_keys, declarations, signals, some_signals
from spec_schema.names import is_dotted_name, is_name, why_reserved
from spec_schema.yaml_tree.nodes import Node, Scalar, Table, kind

Item = TypeVar("Item")


def _read_signals(node: Node, info: ValidationInfo) -> Mapping[str, Node]:
    """Keys are names of signals, those of sub-models with dots."""
    # a signal of a sub-model has a dot: it is no new name
    table = read_table(node, info)
    for name in table.entries:
        if not is_name(name) and not is_dotted_name(name):
            findings_of(info).report(errors.malformed_name(name, table.keys[name]))
    return {n: v for n, v in table.entries.items() if is_name(n) or is_dotted_name(n)}


def _read_some_signals(node: Node, info: ValidationInfo) -> Mapping[str, Node]:
    found = _read_signals(node, info)
    if not found:
        findings_of(info).report(
            errors.empty_section(f"`{info.field_name}`", node.key or node.span)
        )
        raise RefusedError
    return found


# names that are declared: reserved ones are refused where they are written
def _read_declarations(node: Node, info: ValidationInfo) -> Mapping[str, Node]:
    table = read_table(node, info)
    findings = findings_of(info)
    admitted: dict[str, Node] = {}
    for name, value in table.entries.items():
        reason = why_reserved(name)
        if reason is not None:
            findings.report(errors.reserved_name(name, table.keys[name], reason))
        elif not is_name(name):
            findings.report(errors.malformed_name(name, table.keys[name]))
        else:
            admitted[name] = value
    return admitted


def _read_any_keys(node: Node, info: ValidationInfo) -> Mapping[str, Node]:
    return read_table(node, info).entries


def read_table(node: Node, info: ValidationInfo) -> Table:
    """The mapping that a node is; nothing written is an empty one."""
    if isinstance(node, Scalar) and node.is_empty:
        return Table({}, {}, node.span, node.key)
    if not isinstance(node, Table):
        repair = (
            # a lone value under `parameters:` lacks its name
            f"give it a name: `{{NAME: {node.text[:40]}}}`" if isinstance(node, Scalar) else None
        )
        repair = repair or "write for each one `NAME: …`"
        wrong = errors.wrong_kind("a mapping of names", kind(node), node.span, repair)
        findings_of(info).report(wrong)
        raise RefusedError
    return node


Named: TypeAlias = Annotated[Mapping[str, Item], Gathering(_read_declarations, schema=declarations)]
BySignal: TypeAlias = Annotated[Mapping[str, Item], Gathering(_read_signals, schema=signals)]
SomeBySignal: TypeAlias = Annotated[
    Mapping[str, Item], Gathering(_read_some_signals, schema=some_signals)
]
Keyed: TypeAlias = Annotated[Mapping[str, Item], Gathering(_read_any_keys, schema=any_keys)]
