"""Reads mappings of a spec: unknown and missing keys, shorthands, variants, named tables."""

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib import import_module
from inspect import isclass
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Self, TypeAlias, TypeVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ValidationInfo,
    model_validator,
)
from pydantic_core.core_schema import CoreSchema, with_info_plain_validator_function

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema as errors
from spec_schema.fields.leaf import (
    Gathering,
    KeyAndValueSpan,
    LeafField,
    any_keys,
    declarations,
    signals,
    some_signals,
)
from spec_schema.late_dataclass import dataclass
from spec_schema.names import is_dotted_name, is_name, why_reserved
from spec_schema.yaml_tree.nodes import Node, Scalar, Table, kind

# No YAML key can be this: the reader keeps only printable keys.
_PLACE = "\0place"


class RefusedError(ValueError):
    """Tells pydantic that a value was refused; its diagnostic is already in the findings."""


# a place is made by the reader, never read from a file
def _as_given(place: KeyAndValueSpan, info: ValidationInfo) -> KeyAndValueSpan:
    del info
    return place


class Entry(BaseModel):
    """A mapping of a spec, frozen, with the places of its key and of its value.

    Keys that start with `x-` are left to other tools.

    Subclasses say what they are called (`noun`), which key a lone value stands for (`shorthand`)
    which keys of the full language are not read yet (`later`), which keys had another name
    (`former`: the old name, the present one), and what one looks like where a list of its keys says
    little (`example`).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)
    noun: ClassVar[str] = "this section"
    shorthand: ClassVar[str | None] = None
    later: ClassVar[frozenset[str]] = frozenset()
    former: ClassVar[Mapping[str, str]] = MappingProxyType({})
    example: ClassVar[str | None] = None

    place: Annotated[KeyAndValueSpan, LeafField(_as_given)] = Field(alias=_PLACE, repr=False)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Below a field, a reader that builds the schema of the class when a spec has such a part.

        Most specs have few of the parts that there are; where a mistake is, its node knows.
        """
        if handler.field_name is None:
            return handler(source)
        return with_info_plain_validator_function(cls._read)

    @classmethod
    def _read(cls, node: Node, info: ValidationInfo) -> Self:
        return cls.model_validate(node, context=info.context)

    @classmethod
    def known_keys(cls) -> tuple[str, ...]:
        """The keys that this version supports."""
        names = (field.alias or name for name, field in cls.model_fields.items())
        # the place is no key of a file
        return tuple(name for name in names if name != _PLACE)

    @classmethod
    def canonical(cls, node: Node, findings: Findings) -> Node:
        """The node with its shorthand written out, so that validation sees one form only."""
        del findings
        if cls.shorthand is None or isinstance(node, Table):
            return node
        return single_key(node, cls.shorthand)

    @model_validator(mode="before")
    @classmethod
    def _from_node(cls, node: Node, info: ValidationInfo) -> Mapping[str, Any]:
        findings = findings_of(info)
        node = cls.canonical(node, findings)
        # `parameters:` with nothing below is an empty mapping, as people comment entries out
        if isinstance(node, Scalar) and node.is_empty:
            node = Table({}, {}, node.span, node.key)
        if not isinstance(node, Table):
            keys = ", ".join(cls.known_keys())
            written = f"write for example `{cls.example}`"
            repair = written if cls.example else f"{cls.noun} has the keys {keys}"
            findings.report(errors.wrong_kind("a mapping", kind(node), node.span, repair))
            raise RefusedError
        key = node.key or _first_key(node)
        values: dict[str, Any] = {_PLACE: KeyAndValueSpan(key, node.span)}
        values.update(cls._admitted(node, findings))
        missing = [
            field.alias or name
            for name, field in cls.model_fields.items()
            if field.is_required() and (field.alias or name) not in values
        ]
        findings.report(*(errors.missing_key(name, key, cls.noun) for name in missing))
        return values

    @classmethod
    def _admitted(cls, node: Table, findings: Findings) -> Mapping[str, Node]:
        known = cls.known_keys()
        admitted: dict[str, Node] = {}
        for name, value in node.entries.items():
            if name in known:
                admitted[name] = value
            elif name in cls.later:
                findings.report(errors.key_not_yet(name, node.keys[name], cls.noun, known))
            elif cls.former.get(name, name) not in {name, *node.entries}:
                present = cls.former[name]
                findings.report(errors.former_key(name, present, node.keys[name], cls.noun))
                admitted[present] = value
            # editors and other tools keep their own things in a spec
            elif not name.startswith("x-"):
                place, present = node.keys[name], cls.former.get(name)
                findings.report(errors.unknown_key(name, place, cls.noun, known, present))
        return admitted


class OneOf(Entry):
    """A mapping with exactly one key, the name of the variant; a bare name is that with no options.

    Its fields are the variants, all optional; subclasses give the chosen one as `choice`.
    """

    @classmethod
    def canonical(cls, node: Node, findings: Findings) -> Node:
        # `integrator: euler` is `integrator: {euler: {}}`
        if isinstance(node, Scalar) and isinstance(node.value, str):
            empty = Table({}, {}, node.span, node.span)
            node = Table({node.text: empty}, {node.text: node.span}, node.span, node.key)
        if isinstance(node, Table):
            # what belongs to other tools is no variant
            named = [name for name in node.entries if not name.startswith("x-")]
            if len(named) != 1:
                known = cls.known_keys()
                key = node.key or node.span
                findings.report(errors.one_variant(cls.noun, key, named, known))
                raise RefusedError
        return node

    @property
    def kind(self) -> str:
        """The key of the variant that is given."""
        names = (name for name in type(self).model_fields if name != "place")
        return next(name for name in names if getattr(self, name) is not None)

    def chosen(self) -> Entry:
        """The entry of the variant that is given."""
        variant: Entry = getattr(self, self.kind)
        return variant


def findings_of(info: ValidationInfo) -> Findings:
    """The findings of the reading in progress, from pydantic's context."""
    assert isinstance(info.context, Findings)
    return info.context


def single_key(node: Node, key: str) -> Table:
    """A mapping `{key: node}`, with the place of the node."""
    # where a lone value has no key, its own place stands for one
    inner = replace(node, key=node.key or node.span)
    return Table({key: inner}, {key: node.key or node.span}, node.span, node.key)


def _first_key(node: Table) -> Span:
    return next(iter(node.keys.values()), node.span)


Item = TypeVar("Item")


def _read_signals(node: Node, info: ValidationInfo) -> Mapping[str, Node]:
    """The values of a mapping whose keys are names of signals; those of sub-models have dots."""
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
    """The node as a mapping; an empty value is an empty mapping. Reports and raises for others."""
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


def late_entries(module: str, *names: str) -> list[Any]:
    """For each named class of a module, a field type that imports the class only when it is
    used.
    """
    return [Annotated[Any, LateEntry(module, name)] for name in names]


@dataclass(frozen=True)
class LateObject:
    """The name of an object in a module that is imported only when the object is used."""

    module: str
    name: str

    @property
    def value(self) -> Any:
        """The object itself."""
        return getattr(import_module(self.module), self.name)


@dataclass(frozen=True)
class LateEntry(LateObject):
    """The name of an entry's class, in a module that is imported only when a spec has such an
    entry.
    """

    @property
    def kind(self) -> type[Entry]:
        """The class of the entry; imports its module."""
        return self.value

    def __get_pydantic_core_schema__(
        self, source_type: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """A reader that asks the class, as `Entry` has it below a field."""
        del source_type, handler
        return with_info_plain_validator_function(self._read)

    def _read(self, node: Node, info: ValidationInfo) -> Entry:
        return self.kind.model_validate(node, context=info.context)


def kinds_within(first: type[Entry]) -> Iterator[type[Entry]]:
    """The kind itself and all nested kinds, outer ones first."""
    known, waiting = {first}, [first]
    while waiting:
        entry = waiting.pop(0)
        yield entry
        fields = entry.model_fields.values()
        found = [kind for field in fields for kind in kinds_of(field.annotation)]
        inner = [kind for kind in dict.fromkeys(found) if kind not in known]
        known.update(inner)
        # depth first, in the order of the fields
        waiting = [*inner, *waiting]


def kinds_of(annotation: Any) -> list[type[Entry]]:
    """The kinds of mappings that a field of this type holds."""
    if isclass(annotation) and issubclass(annotation, Entry):
        return [annotation]
    if isinstance(annotation, LateEntry):
        return [annotation.kind]
    return [kind for part in get_args(annotation) for kind in kinds_of(part)]


def about(kind: type[Entry]) -> str:
    """The first paragraph of the class's docstring, which describes the entry in editors
    and pages.
    """
    return " ".join((inspect.getdoc(kind) or "").partition("\n\n")[0].split())
