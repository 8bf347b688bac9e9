"""The `export` section: which targets are written, and of what."""

from typing import Annotated, ClassVar, Literal, TypeAlias, TypeVar, get_args

from pydantic import Field

from spec_schema.fields.entry import Entry
from spec_schema.fields.plain import (
    DifferentOf,
    Dtype,
    NewName,
    NonNegativeCount,
    References,
    Switch,
    choice,
)
from spec_schema.registry import ARITHMETICS, TARGETS, FixedPoint, with_keys

OwnEntry = TypeVar("OwnEntry", bound="TargetEntry")
Slopes: TypeAlias = Literal["jacobian", "state_jacobian", "parameter_jacobian"]
Extra: TypeAlias = Literal["jacobian", "state_jacobian", "parameter_jacobian", "ros2"]
CDtype: TypeAlias = Annotated[
    Literal["float32", "float64"] | FixedPoint, choice("float32", "float64", *ARITHMETICS)
]
UnitPlatform: TypeAlias = Literal[
    "x86_64-linux", "aarch64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin"
]
"""As FMI 3.0 calls them."""


class TargetEntry(Entry):
    """The options of every target: `outputs` are kept (by default all), the inputs in `close` are
    fed back.
    """

    # None is not (): all outputs, or none of them
    outputs: References | None = None
    """Outputs that are kept, or equations; by default all outputs."""
    close: References = ()
    """Inputs that are fed back inside; none by default."""


class FloatTargetEntry(TargetEntry):
    """A target that computes in floating point; `dtype` is its precision."""

    dtype: Dtype | None = None
    """Type of the numbers."""


class TorchExport(FloatTargetEntry):
    """A torch module."""

    noun: ClassVar[str] = "the torch export"


class OnnxExport(FloatTargetEntry):
    """An ONNX model."""

    noun: ClassVar[str] = "the onnx export"


class CasadiExport(FloatTargetEntry):
    """CasADi functions; their names start with `prefix`, by default the name of the spec.

    `params: input` makes the parameters inputs of the functions, `inline` writes their values into
    the functions. `form: sx` makes expressions of scalars, whose derivatives cost least for models
    of some hundred operations; `mx` keeps arrays. `smooth: true` rounds off the kinks within the
    declared ranges, for solvers that need second derivatives.
    """

    noun: ClassVar[str] = "the casadi export"

    prefix: NewName | None = None
    params: Annotated[Literal["input", "inline"], choice("input", "inline")] = "input"
    """Parameters as inputs of the functions, or as numbers in them."""
    form: Annotated[Literal["mx", "sx"], choice("mx", "sx")] = "mx"
    """Expressions of arrays, or of single numbers."""
    # three meanings: true smooths, false accepts, None warns
    smooth: Switch | None = None
    """Whether kinks are rounded off; false accepts them, and by default they are warned of."""


class CExport(TargetEntry):
    """C sources; names start with `prefix`, by default the name of the spec.

    Parameters: `params: const` makes them constants, `tunable` gives the step a pointer to them,
    `calibration` also puts them with a checksum into a section of memory, `inline` writes them into
    the code.

    Code: `ring` is the way in which windows are stored, `unroll` the number of passes up to which
    loops are written out. `constant_time` makes every step execute the same instructions for all
    numbers. With the `dtype` q15 or q31 the code computes in integers.

    Inputs: if the step reads samples after t of an input in `delay`, the step gets its newest
    sample instead and its outputs are late.

    Functions in `with`: `jacobian` linearises a step in its complete memory and its inputs,
    `state_jacobian` in the declared states and the inputs. `parameter_jacobian` also linearises in
    the parameters. `ros2` is a node of ROS 2.
    """

    noun: ClassVar[str] = "the c export"

    prefix: NewName | None = None
    dtype: CDtype | None = None
    """Type of the numbers; `q15` and `q31` are integers."""
    params: Annotated[
        Literal["const", "tunable", "calibration", "inline"],
        choice("const", "tunable", "calibration", "inline"),
    ] = "const"
    """Parameters as constants, through a pointer, in a section with a checksum, or in the code."""
    math: Annotated[Literal["own", "libm"], choice("own", "libm")] = "own"
    """Own math functions, or those of the C library."""
    ring: Annotated[Literal["auto", "shift", "double"], choice("auto", "shift", "double")] = "auto"
    """How windows move."""
    unroll: NonNegativeCount = 4
    """Loops of up to so many passes are written out."""
    constant_time: Switch = False
    """Every step takes the same instructions, whatever its numbers are."""
    delay: References = ()
    """Inputs whose samples after t a step waits for: outputs are as many samples late."""
    extras: DifferentOf[
        Annotated[Extra, choice("jacobian", "state_jacobian", "parameter_jacobian", "ros2")]
    ] = Field(default=(), alias="with")
    """What is generated beside the step: its slopes in states, inputs and parameters, a node."""


class FmuExport(FloatTargetEntry):
    """Functional Mock-up Units; names start with `prefix`, by default the name of the spec.

    If the step reads samples after t of an input in `delay`, it gets its newest sample instead and
    its outputs are late. `platforms` are compiled for in addition to this machine.
    """

    noun: ClassVar[str] = "the fmu export"

    prefix: NewName | None = None
    delay: References = ()
    """Inputs whose samples after t a step waits for: outputs are as many samples late."""
    platforms: DifferentOf[Annotated[UnitPlatform, choice(*get_args(UnitPlatform))]] = ()
    """Kinds of machines to compile for as well, by zig."""


@with_keys(TARGETS)
class Export(Entry):
    """The targets that `msnn export` writes; a target without an entry is not requested."""

    noun: ClassVar[str] = "export"
    later: ClassVar[frozenset[str]] = frozenset({"report"})

    torch: TorchExport | None = None
    """A module that needs only torch."""
    onnx: OnnxExport | None = None
    """An ONNX model with explicit states."""
    casadi: CasadiExport | None = None
    """A CasADi function."""
    c: CExport | None = None
    """C99 sources."""
    fmu: FmuExport | None = None
    """Units for co-simulation by FMI 2.0 and 3.0."""
    # fields of targets that features bring, such as `mpc`, follow from the registry

    def entry(self, kind: type[OwnEntry]) -> OwnEntry | None:
        """The entry of the target whose class is `kind`; None if the spec has none."""
        return next((entry for entry in self._entries if isinstance(entry, kind)), None)

    @property
    def asked(self) -> frozenset[str]:
        """The names of the targets that the section lists."""
        return frozenset(
            name for name in self.known_keys() if getattr(self, name, None) is not None
        )

    @property
    def named_outputs(self) -> frozenset[str]:
        """All names in `outputs:` of any target."""
        wanted = (entry.outputs or () for entry in self._entries)
        return frozenset(name.value for names in wanted for name in names)

    @property
    def _entries(self) -> tuple[TargetEntry, ...]:
        # of the fields, so that a new target is known to all three above
        values = (getattr(self, name, None) for name in type(self).model_fields)
        return tuple(value for value in values if isinstance(value, TargetEntry))
