"""The `export` section: which targets are written, and of what."""

from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field

from spec_schema.fields.entry import Entry
from spec_schema.fields.plain import (
    CDtype,
    DifferentOf,
    Dtype,
    NewName,
    NonNegativeCount,
    References,
    Switch,
    choice,
)

Extra: TypeAlias = Literal["jacobian", "state_jacobian", "parameter_jacobian"]


class Target(Entry):
    """What every target takes: `outputs` to keep (None: all) and inputs to `close`."""

    outputs: References | None = None
    """Outputs that are kept, or equations; by default all outputs."""
    close: References = ()
    """Inputs that are fed back inside; none by default."""


class FloatTarget(Target):
    """A target that computes in floating point of one size, its number type."""

    dtype: Dtype | None = None
    """Type of the numbers."""


class TorchExport(FloatTarget):
    """A torch module."""

    noun: ClassVar[str] = "the torch export"


class OnnxExport(FloatTarget):
    """An ONNX model."""

    noun: ClassVar[str] = "the onnx export"


class CasadiExport(FloatTarget):
    """A CasADi function; names start with `prefix`, by default the name of the spec."""

    noun: ClassVar[str] = "the casadi export"

    prefix: NewName | None = None


class CExport(Target):
    """C sources; names start with `prefix`, by default the name of the spec.

    `params: inline` writes parameters into the code, the others give the step a pointer to them.
    `ring` says how windows move, `unroll` up to how many elements loops are written out.
    `constant_time` makes every step take the same instructions, whatever its numbers are.
    With the `dtype` q15 or q31 the C computes in integers. `with: jacobian` adds a function that
    linearises a step in all that it remembers and its inputs, `with: state_jacobian` in declared
    states instead, `with: parameter_jacobian` in parameters too.
    """

    noun: ClassVar[str] = "the c export"

    prefix: NewName | None = None
    dtype: CDtype | None = None
    """Type of the numbers; `q15` and `q31` are integers."""
    params: Annotated[
        Literal["const", "tunable", "inline"], choice("const", "tunable", "inline")
    ] = "const"
    """Parameters as constants, through a pointer, or written into the code."""
    math: Annotated[Literal["own", "libm"], choice("own", "libm")] = "own"
    """Own math functions, or those of the C library."""
    ring: Annotated[Literal["auto", "shift", "double"], choice("auto", "shift", "double")] = "auto"
    """How windows move."""
    unroll: NonNegativeCount = 4
    """Loops of up to so many passes are written out."""
    constant_time: Switch = False
    """Every step takes the same instructions, whatever its numbers are."""
    extras: DifferentOf[
        Annotated[Extra, choice("jacobian", "state_jacobian", "parameter_jacobian")]
    ] = Field(default=(), alias="with")
    """What is generated beside the step: its slopes in states, inputs and parameters."""


class Export(Entry):
    """The targets that `msnn export` writes; None where not asked for."""

    noun: ClassVar[str] = "export"
    later: ClassVar[frozenset[str]] = frozenset({"fmu", "mpc", "report"})

    torch: TorchExport | None = None
    """A module that needs only torch."""
    onnx: OnnxExport | None = None
    """An ONNX model with explicit states."""
    casadi: CasadiExport | None = None
    """A CasADi function."""
    c: CExport | None = None
    """C99 sources."""

    @property
    def named_outputs(self) -> frozenset[str]:
        """All that the `outputs:` of any target name."""
        targets = (self.torch, self.onnx, self.casadi, self.c)
        wanted = (target.outputs or () for target in targets if target is not None)
        return frozenset(name.value for names in wanted for name in names)
