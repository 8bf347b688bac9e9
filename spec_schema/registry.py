"""Lists what the features of msnn bring, before anything of a feature is imported.

This is the only file that names modules of features in strings: whoever moves a module of a feature
looks here. The objects that the strings name are imported when a command needs them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated, Any, Optional, Protocol, TypeVar

from pydantic import Field
from pydantic.fields import FieldInfo

from spec_schema.fields.entry import Entry
from spec_schema.fields.late_entry import LateEntry, LateObject
from spec_schema.late_dataclass import dataclass

E = TypeVar("E", bound=Entry)


class KeyLine(Protocol):
    """A key that a feature adds to a mapping of the spec."""

    @property
    def key(self) -> str: ...

    @property
    def entry(self) -> LateEntry:
        """The class of its value."""
        ...

    @property
    def about(self) -> str:
        """The sentence about the key in editors, in the JSON Schema and in docs/keys.md."""
        ...


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


SECTIONS = (
    SectionLine(
        "mpc",
        LateEntry("msnn.features.control.keys.mpc", "OptimalControl"),
        LateObject("msnn.features.control.sections", "MPC"),
        "The predictive controller whose plant is this model.",
    ),
    SectionLine(
        "estimator",
        LateEntry("msnn.features.control.keys.estimator", "Estimator"),
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
    """The `spec_schema.sections.part.PartKind` that reads its file."""
    members: LateObject
    """The `compiler.elaboration.part_members.PartMembers` of what stands after its dot."""
    about: str
    title: str
    """The word for it in messages."""
    file: str
    """The key of its entry that names its file."""
    file_title: str
    """The word for its file in messages."""
    suffix: str
    """The end of the name under which a run keeps its file."""


PARTS = (
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


TARGETS = (
    TargetLine(
        "mpc",
        LateEntry("msnn.features.control.keys.export", "MpcExport"),
        LateObject("msnn.features.control.export.target", "TARGET"),
        "The controller of the `mpc` section as C99.",
        title="controllers",
        help="the controller of an `mpc` section and the filter of an `estimator` as C99",
        sections=("mpc", "estimator"),
        extras=("fmu",),
    ),
)
"""In the order in which they are written, after those of the core."""

VERIFIED_EXPORTS = (
    LateObject("msnn.features.control.verification.verified_export", "CONTROLLERS"),
)
"""The kinds of exports that `msnn verify` checks besides the C of a model, each a
`msnn.verification.verified_export.VerifiedExport`."""


def with_keys(
    lines: Iterable[KeyLine], *, after: str | None = None
) -> Callable[[type[E]], type[E]]:
    """Adds an optional field for each line to the class of a mapping: last, or after a key.

    `Entry` defers building its schema to the first use, so the fields arrive in time.
    """

    def add(mapping: type[E]) -> type[E]:
        fields = mapping.__pydantic_fields__
        names = list(fields)
        later = [] if after is None else names[names.index(after) + 1 :]
        for line in lines:
            # pyright knows no `Annotated[…] | None`
            kind: Any = Optional[Annotated[Any, line.entry]]  # noqa: UP045
            field = Field(default=None, description=line.about)
            fields[line.key] = FieldInfo.from_annotated_attribute(kind, field)
        for name in later:
            fields[name] = fields.pop(name)
        return mapping

    return add
