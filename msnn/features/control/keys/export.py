"""The keys of `export: {mpc: …}`."""

from typing import Annotated, ClassVar, Literal, TypeAlias, get_args

from pydantic import Field

from spec_schema.fields.plain import DifferentOf, NewName, choice
from spec_schema.sections.exports import FloatTargetEntry, UnitPlatform

OnlineExtra: TypeAlias = Literal["fmu"]


class MpcExport(FloatTargetEntry):
    """The controller of the `mpc` section and the filter of the `estimator`, where there are any.

    Names start with `prefix`, by default the spec's name. What is controlled, measured and fed
    back stands in those sections: `outputs` and `close` are none of its keys. `with: fmu` adds
    units for co-simulation of what is written.
    """

    noun: ClassVar[str] = "the mpc export"

    prefix: NewName | None = None
    extras: DifferentOf[Annotated[OnlineExtra, choice("fmu")]] = Field(default=(), alias="with")
    """What is generated beside the C: units of FMI 2.0 and 3.0."""
    platforms: DifferentOf[Annotated[UnitPlatform, choice(*get_args(UnitPlatform))]] = ()
    """Kinds of machines to compile the units for as well, by zig."""
