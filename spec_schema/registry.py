"""Lists what the features of msnn bring to a spec, before anything of a feature is imported.

This is the only file that names modules of features in strings: whoever moves a module of a feature
looks here. The classes that the strings name are imported when a spec needs them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Optional, TypeVar

from pydantic import Field
from pydantic.fields import FieldInfo

from spec_schema.fields.entry import Entry
from spec_schema.fields.late_entry import LateEntry, LateObject
from spec_schema.late_dataclass import dataclass

S = TypeVar("S", bound=Entry)


@dataclass(frozen=True)
class SectionLine:
    """A section of the spec that a feature brings."""

    key: str
    entry: LateEntry
    """The class of its keys."""
    section: LateObject
    """The `compiler.elaboration.section.Section` that compiles it."""
    about: str
    """The sentence about the key in editors, in the JSON Schema and in docs/keys.md."""
    is_model: bool = False
    """True if the section is part of the model and its hash, False if it only uses the model."""


SECTIONS = (
    SectionLine(
        "mpc",
        LateEntry("spec_schema.sections.optimal_control", "OptimalControl"),
        LateObject("msnn.features.control.sections", "MPC"),
        "The predictive controller whose plant is this model.",
    ),
    SectionLine(
        "estimator",
        LateEntry("spec_schema.sections.estimation", "Estimator"),
        LateObject("msnn.features.control.sections", "ESTIMATOR"),
        "How states that nobody measures are found while it runs.",
    ),
)
"""In the order in which `fmt` and the JSON Schema list them, after the keys of the core."""


def with_sections() -> Callable[[type[S]], type[S]]:
    """Adds an optional field for each line of `SECTIONS` to the class of a spec.

    `Entry` defers building its schema to the first use, so the fields arrive in time.
    """

    def add(spec: type[S]) -> type[S]:
        for line in SECTIONS:
            # pyright knows no `Annotated[…] | None`
            kind: Any = Optional[Annotated[Any, line.entry]]  # noqa: UP045
            field = Field(default=None, description=line.about)
            spec.__pydantic_fields__[line.key] = FieldInfo.from_annotated_attribute(kind, field)
        return spec

    return add
