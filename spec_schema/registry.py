"""Lists what the features of msnn bring, before anything of a feature is imported.

This is the only file that names modules of features in strings: whoever moves a module of a feature
looks here. The objects that the strings name are imported when a command needs them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Generic, Literal, Optional, Protocol, TypeAlias, TypeVar

from pydantic import Field
from pydantic.fields import FieldInfo

from spec_schema.expressions.language import Signature
from spec_schema.fields.entry import Entry, LateEntry, LateObject
from spec_schema.late_dataclass import dataclass

E = TypeVar("E", bound=Entry)


class KeyLine(Protocol):
    """A line about a key that a feature adds to a mapping of the spec, such as a section."""

    @property
    def key(self) -> str: ...

    @property
    def entry(self) -> LateEntry:
        """The class that reads the value of the key."""
        ...

    @property
    def about(self) -> str:
        """The sentence about the key in editors, in the JSON Schema and in docs/keys.md."""
        ...


FeatureLine = TypeVar("FeatureLine", bound=KeyLine)


class FeatureLines(Generic[FeatureLine]):
    """The lines of one kind, such as sections: those of msnn's features, then those of plug-ins.

    Each line adds a key to the mappings of the spec to which `add_to` was applied.
    """

    def __init__(self, *ours: FeatureLine) -> None:
        self.ours = ours
        self.of_plugins: tuple[FeatureLine, ...] = ()
        self._mappings: list[type[Entry]] = []

    def __iter__(self) -> Iterator[FeatureLine]:
        return iter((*self.ours, *self.of_plugins))

    def add_to(self, mapping: type[Entry], after: str | None = None) -> None:
        """Adds an optional field to a class of the spec for each line, now and for lines of
        plug-ins later.

        Fields of msnn's features follow the key `after`, or are the last.
        """
        self._mappings.append(mapping)
        fields = mapping.__pydantic_fields__
        names = list(fields)
        following = [] if after is None else names[names.index(after) + 1 :]
        for line in self:
            _add_field(mapping, line)
        for name in following:
            fields[name] = fields.pop(name)

    def add(self, line: FeatureLine) -> None:
        """Adds the line of a plug-in, also to mappings whose schema is built already."""
        self.of_plugins += (line,)
        for mapping in self._mappings:
            _add_field(mapping, line)
            # entries that were read before lack the field
            setattr(mapping, line.key, None)
            mapping.model_rebuild(force=True)

    def remove(self, line: FeatureLine) -> None:
        """Removes the line of a plug-in."""
        self.of_plugins = tuple(each for each in self.of_plugins if each is not line)
        for mapping in self._mappings:
            del mapping.__pydantic_fields__[line.key]
            delattr(mapping, line.key)
            mapping.model_rebuild(force=True)

    def is_free(self, key: str) -> bool:
        """True if a plug-in may add this key: no field or attribute has the name yet."""
        return not any(
            key in (*each.known_keys(), *each.model_fields) or hasattr(each, key)
            for each in self._mappings
        )


@dataclass(frozen=True)
class SectionLine:
    """A section of the spec that a feature brings."""

    key: str
    entry: LateEntry
    section: LateObject
    """The `compiler.elaboration.section.Section` that compiles it."""
    about: str
    is_model: bool = False
    """True if the section is part of the model and its hash, False if it only uses the model."""


SECTIONS = FeatureLines(
    SectionLine(
        "mpc",
        LateEntry("msnn.features.control.keys", "OptimalControl"),
        LateObject("msnn.features.control.sections", "MPC"),
        "The predictive controller whose plant is this model.",
    ),
    SectionLine(
        "estimator",
        LateEntry("msnn.features.control.keys", "Estimator"),
        LateObject("msnn.features.control.sections", "ESTIMATOR"),
        "How states that nobody measures are found while it runs.",
    ),
)
"""In the order in which `fmt` and the JSON Schema list them, after the keys of the core."""


@dataclass(frozen=True)
class PartLine:
    """A kind of parts in `use` that a feature brings, besides other specs."""

    key: str
    """Its key in an entry of `use`, and its word in the records of runs."""
    entry: LateEntry
    kind: LateObject
    """The `spec_schema.sections.submodels.PartKind` that reads its file."""
    members: LateObject
    """The `compiler.elaboration.names.PartMembers` of what stands after its dot."""
    about: str
    title: str
    """The word for it in messages."""
    file: str
    """The key of its entry that names its file."""
    file_title: str
    """The word for its file in messages."""
    suffix: str
    """The end of the name under which a run keeps its file."""


PARTS = FeatureLines(
    PartLine(
        "robot",
        LateEntry("msnn.features.robots.keys", "Robot"),
        kind=LateObject("msnn.features.robots.part", "ROBOT"),
        members=LateObject("msnn.features.robots.dynamics.calls", "ROBOT_MEMBERS"),
        about="The rigid-body dynamics of what a URDF file describes; calls such as "
        "`arm.mass_matrix(q)`.",
        title="robot",
        file="urdf",
        file_title="URDF",
        suffix=".urdf",
    ),
)
"""In the order in which `fmt` and the JSON Schema list them, after `spec`."""


@dataclass(frozen=True)
class TargetLine:
    """A target of `msnn export` that a feature brings."""

    key: str
    """Its name on the command line and in `export:`."""
    entry: LateEntry
    target: LateObject
    """The `msnn.exports.target.Target` that writes it."""
    about: str
    title: str
    """The word for it in messages."""
    help: str
    """Its part of the help text of `msnn export`."""
    sections: tuple[str, ...] = ()
    """The spec must have one of these sections."""
    extras: tuple[str, ...] = ()
    """Names that `--with` and the `with:` of the entry may have."""


TARGETS = FeatureLines(
    TargetLine(
        "mpc",
        LateEntry("msnn.features.control.keys", "MpcExport"),
        LateObject("msnn.features.control.export.target", "TARGET"),
        "The controller of the `mpc` section as C99.",
        title="controllers",
        help="the controller of an `mpc` section and the filter of an `estimator` as C99",
        sections=("mpc", "estimator"),
        extras=("fmu",),
    ),
)
"""In the order in which they are written, after those of the core."""

FixedPoint: TypeAlias = Literal["q15", "q31"]


@dataclass(frozen=True)
class ArithmeticLine:
    """An arithmetic of integers in which the target `c` can compute."""

    target: LateObject
    """The `msnn.exports.target.Target` that plans, writes, loads and checks C in it."""
    word_bits: int
    """Of inputs, outputs, coefficients and most states."""
    sum_bits: int
    """Of sums and products, and of states that are summed up."""


_FIXED_POINT = LateObject("msnn.features.fixed_point.target", "TARGET")
ARITHMETICS: dict[FixedPoint, ArithmeticLine] = {
    "q15": ArithmeticLine(_FIXED_POINT, word_bits=16, sum_bits=32),
    "q31": ArithmeticLine(_FIXED_POINT, word_bits=32, sum_bits=64),
}
"""By the `dtype` of `export: {c: …}` that asks for it."""


@dataclass(frozen=True)
class LayerLine:
    """A kind of layer that a plug-in brings."""

    key: str
    entry: LateEntry
    """The class of its settings."""
    rule: LateObject
    """The `compiler.layers.rules.layer_rule.LayerRule` that expands it into core operations."""
    about: str


LAYERS: FeatureLines[LayerLine] = FeatureLines()
"""The layers of plug-ins; those of msnn are fields of `Layer` and files in `compiler/layers/`."""


@dataclass(frozen=True)
class FunctionLine:
    """A function of expressions that a plug-in brings."""

    key: str
    """Its name in expressions; a name that a spec declares comes first."""
    signature: Signature
    expand: LateObject
    """The function `(builder, *arguments) -> node` that makes it of core operations."""


FUNCTIONS: dict[str, FunctionLine] = {}
"""The functions of plug-ins; those of msnn are builtins of the compiler."""


@dataclass(frozen=True)
class VerbLine:
    """A command of `msnn` that a plug-in brings."""

    key: str
    """Its name on the command line."""
    help: str
    """Its line in `msnn --help`."""
    command: LateObject
    """A function whose parameters typer reads, or a `typer.Typer` with several of them."""


VERBS: dict[str, VerbLine] = {}
"""The verbs of plug-ins; those of msnn are files in `msnn/cli/verbs/`."""


@dataclass(frozen=True, kw_only=True)
class FormatLine:
    """A format of data files that a plug-in brings."""

    name: str
    """Its name in messages."""
    suffixes: tuple[str, ...]
    """The ends of its files' names, with the dot and in lower case."""
    read: LateObject
    """The function `(path, its name in messages) -> msnn.extending.DataColumns`."""
    is_text: bool = False
    """True if a message may show a line of the file."""
    is_isolated: bool = False
    """True if a separate process reads it, because a malformed file may crash its compiled
    reader.
    """


FORMATS: dict[str, FormatLine] = {}
"""The formats of plug-ins by suffix; those of msnn are in `msnn.data.formats`."""

VERIFIED_EXPORTS = (
    LateObject("msnn.features.control.verification.verified_export", "CONTROLLERS"),
)
"""The kinds of exports that `msnn verify` checks besides the C of a model, each a
`msnn.verification.verify.VerifiedExport`."""


def with_keys(
    lines: FeatureLines[Any], *, after: str | None = None
) -> Callable[[type[E]], type[E]]:
    """A class decorator that adds an optional field for each line: last, or after a key.

    `Entry` defers building its schema to the first use, so the fields arrive in time.
    """

    def add(mapping: type[E]) -> type[E]:
        lines.add_to(mapping, after)
        return mapping

    return add


def _add_field(mapping: type[Entry], line: KeyLine) -> None:
    # pyright knows no `Annotated[…] | None`
    kind: Any = Optional[Annotated[Any, line.entry]]  # noqa: UP045
    field = Field(default=None, description=line.about)
    mapping.__pydantic_fields__[line.key] = FieldInfo.from_annotated_attribute(kind, field)


@dataclass(frozen=True, kw_only=True)
class Feature:
    """The description of a plug-in: all lines that it brings.

    Its entry point in `msnn.features` names it.

    Its lines name objects by their modules, as those of msnn's own features do.
    """

    name: str
    """Its name in messages."""
    sections: tuple[SectionLine, ...] = ()
    """Sections of the spec."""
    targets: tuple[TargetLine, ...] = ()
    """Targets of `msnn export` that write text."""
    layers: tuple[LayerLine, ...] = ()
    """Kinds of layers."""
    functions: tuple[FunctionLine, ...] = ()
    """Functions of expressions."""
    verbs: tuple[VerbLine, ...] = ()
    """Verbs of the command line."""
    formats: tuple[FormatLine, ...] = ()
    """Formats of data files."""
