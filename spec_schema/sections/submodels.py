"""Sub-models: specs that a spec uses as parts; other kinds of parts, which features bring."""

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Annotated, Any, ClassVar, Generic, Protocol, TypeAlias, TypeVar

from pydantic import ValidationInfo, model_validator

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, RefusedError, findings_of, read_table
from spec_schema.fields.formulas import ExpressionField
from spec_schema.fields.leaf import Gathering, Located, members
from spec_schema.fields.plain import LocatedText, Text, reads, scalar
from spec_schema.late_dataclass import dataclass
from spec_schema.names import is_dotted_name
from spec_schema.registry import PARTS, PartLine, with_keys
from spec_schema.sections.values import Dimension
from spec_schema.units.quantity import Quantity
from spec_schema.yaml_tree.nodes import Listing, Node, Table, kind

E = TypeVar("E", bound=Entry)
M = TypeVar("M")


class SpecAround(Protocol):
    """The spec that uses a part, reduced to the facts that a part may use: dimensions and sample
    time.
    """

    @property
    def dims(self) -> Mapping[str, Dimension]: ...

    @property
    def sample_time(self) -> Quantity | None: ...


@dataclass(frozen=True)
class PartRead(Generic[M]):
    """A part after its file was read: the data for its functions, and the names that it
    declares.
    """

    model: M
    """The data that its members compute with."""
    spec: Node
    """Its dims and parameters, as the tree of a spec with the places of its file."""


@dataclass(frozen=True, kw_only=True)
class PartKind(Generic[E, M]):
    """A kind of part, such as a robot: how its file is read, shown and compared.

    `E` is the class of its entry in `use`, `M` that of the data that are read.
    """

    largest_file: int
    """In bytes."""
    read: Callable[[E, SourceText, str, SpecAround, Findings], PartRead[M] | None]
    """The part, from its entry, the text of its file, its name and the spec around it; None once
    the mistakes are reported."""
    difference: Callable[[str, str], str | None]
    """The difference of two texts of its file in words, that of a run and that of today; None if
    both describe one part."""
    unreadable: Callable[[str, str, Span], Diagnostic]
    """The report of a file that cannot be read, by its path and the reason."""
    beside_spec: Callable[[Span], Diagnostic]
    """The report of an entry of `use` with another kind of part too."""
    with_weights: Callable[[Span], Diagnostic]
    """The report of `weights` beside it."""


AnyPartKind: TypeAlias = PartKind[Any, Any]


def part_kind(line: PartLine) -> AnyPartKind:
    """The kind of part in a line of the registry; its module is imported at the first use."""
    kind: AnyPartKind = line.kind.value
    return kind


@dataclass(frozen=True)
class Freeze:
    """`all`, `none`, `gain` or `[gain, rod.*]`: the parameters of a sub-model that are constants.

    Patterns match the names in the sub-model's own file.
    """

    patterns: tuple[Located[str], ...] = ()
    span: Span | None = field(default=None, compare=False)


_FREEZE = {"type": ["string", "array"], "items": {"type": "string", "minLength": 1}}


def _read_freeze(node: Node, findings: Findings) -> Freeze:
    match node:
        case Listing(items=items):
            patterns = tuple(_pattern(item, findings) for item in items)
        case Table():
            repair = "write `all`, `none` or a list of names such as `[W, phi.*]`"
            place = node.key or node.span
            findings.report(errors.wrong_kind("a list of names", kind(node), place, repair))
            raise RefusedError
        case _:
            pattern = _pattern(node, findings)
            # words become patterns, so that everybody behind meets one form
            word = {"all": "*", "none": None}.get(pattern.value, pattern.value)
            patterns = () if word is None else (Located(word, pattern.span, pattern.key),)
    return Freeze(patterns, node.span)


def _pattern(node: Node, findings: Findings) -> Located[str]:
    found = scalar(node, findings, "`all`, `none` or a list of names")
    return Located(found.text, found.span, found.key)


@with_keys(PARTS, after="spec")
class Use(Entry):
    """Another spec as a sub-model of this one; its names are used here with that of the sub-model
    first: `plant.mass`.

    `weights` is the file that a training of the sub-model wrote; without it, its initial values are
    used. `freeze` makes its parameters constants of this model: `all`, `none` or patterns of their
    names. Instead of a spec it can be a robot, whose dynamics are called as
    `NAME.forward_dynamics(q, dq, tau)`.
    """

    noun: ClassVar[str] = "a sub-model"
    shorthand: ClassVar[str | None] = "spec"

    spec: LocatedText | None = None
    """File of the spec, relative to this one."""
    # fields of kinds of parts that features bring, such as `robot`, follow from the registry
    weights: LocatedText | None = None
    """File of weights that a training of it wrote; initial values without it."""
    freeze: Annotated[Freeze, reads(_read_freeze, _FREEZE)] = Freeze()
    """Parameters that are constants here: `all`, `none` or a list; `*` is any text."""
    doc: Text | None = None

    @property
    def file(self) -> Located[str]:
        """The file that is used, with its place: a spec, or the file of another kind of part."""
        if self.part is None:
            assert self.spec is not None
            return self.spec
        line, entry = self.part
        return getattr(entry, line.file)

    @property
    def part(self) -> tuple[PartLine, Entry] | None:
        """The kind of part that is used instead of a spec, and its entry; None for a spec."""
        return next(iter(self._parts()), None)

    def _parts(self) -> list[tuple[PartLine, Entry]]:
        given = ((line, getattr(self, line.key)) for line in PARTS)
        return [(line, entry) for line, entry in given if entry is not None]

    @model_validator(mode="after")
    def _is_one_of_both(self, info: ValidationInfo) -> "Use":
        findings = findings_of(info)
        parts = self._parts()
        if not parts:
            if self.spec is None:
                findings.report(errors.missing_key("spec", self.place.key, self.noun))
            return self
        line, entry = parts[-1]
        if self.spec is not None or len(parts) > 1:
            findings.report(part_kind(line).beside_spec(entry.place.key))
        # what such a part learns are parameters of this spec, and in its own weights
        elif self.weights is not None:
            findings.report(part_kind(line).with_weights(self.weights.span))
        return self


class Connection(Entry):
    """An expression that is the value of a sub-model's input; `history` are the values before the
    start.
    """

    noun: ClassVar[str] = "a connection"
    shorthand: ClassVar[str | None] = "expr"

    expr: ExpressionField
    """What the input is, in the same step and in its past."""
    history: ExpressionField | None = None
    """Values of the input before the start."""
    doc: Text | None = None


def _read_inputs(node: Node, info: ValidationInfo) -> Mapping[str, Node]:
    """The entries of `connect` by key. A key that is not an input of a sub-model, with a dot in the
    name, is reported and left out.
    """
    table = read_table(node, info)
    admitted: dict[str, Node] = {}
    for name, value in table.entries.items():
        if is_dotted_name(name):
            admitted[name] = value
        else:
            findings_of(info).report(errors.malformed_member(name, table.keys[name]))
    return admitted


Connections = Annotated[Mapping[str, Connection], Gathering(_read_inputs, schema=members)]
