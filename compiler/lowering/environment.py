"""The environment of an expression: the part of the program, the time and the enclosing call in
which it is lowered.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from enum import Enum
from fractions import Fraction

from compiler.ir.program import NodeId
from spec_schema.expressions.tree import Expression
from spec_schema.late_dataclass import dataclass

Time = tuple[int, tuple[int, int] | None]
"""Shift and window: the samples, relative to t, at which an expression is evaluated."""


class EnvironmentPart(Enum):
    """The part of a program in which an expression is lowered; it decides the meaning of names
    (R6).
    """

    STEP = "the step"
    """An input is the value that the step sees; a state is its simulated value."""
    LOSS = "a loss"
    """A bare input is its recorded value; equations mean the same as in the step."""
    START = "an initial value"
    """Evaluated once, at t0, from the log; there is no simulation yet (R7)."""
    CONSTANT = "a constant"
    """Evaluated by the compiler; it reads no signals or parameters."""


@dataclass(frozen=True, eq=False)
class IntegratorStage:
    """One evaluation of a right-hand side by the integrator within a step, such as one of the four
    of Runge-Kutta (R6).

    Objects are compared by identity, so two stages are never equal.
    """

    values: Mapping[str, NodeId]
    """Values of the integrated states at this stage, by name."""
    fraction: Fraction
    """Elapsed fraction of the step: 0 at sample t, 1 at sample t+1."""
    owner: str = ""
    """The sub-model whose states are integrated; "" for the model itself."""


@dataclass(frozen=True, eq=False)
class FunctionArgument:
    """An argument of a call of a function of the spec; the function's formula replaces the call.

    It becomes a node where the formula uses it, once for each time in `lowered`. `environment` is
    that of the call.
    """

    expression: Expression
    environment: Environment
    lowered: dict[Time, NodeId] = field(default_factory=dict["Time", NodeId])
    at_hand: bool = False
    """True if the value exists already as a node; the expression is only its name."""


@dataclass(frozen=True, eq=False)
class Environment:
    """The part of the program, the time, the integrator stage and the enclosing calls in which an
    expression is lowered; they decide the meaning of its names.
    """

    part: EnvironmentPart
    shift: int = 0
    """Offset in samples of every signal that is read, positive for later samples: −3 in
    `e[t-3]`."""
    window: tuple[int, int] | None = None
    """First and last sample of the time window that the expression is evaluated over."""
    stage: IntegratorStage | None = None
    arguments: Mapping[str, FunctionArgument] = field(default_factory=dict[str, FunctionArgument])
    functions: tuple[str, ...] = ()
    """The functions being inlined, outermost first."""

    def shifted(self, samples: int) -> Environment:
        """The environment in which every signal is read `samples` later, or earlier if negative."""
        return replace(self, shift=self.shift + samples)

    def over(self, first: int, last: int) -> Environment:
        """The environment in which every signal is read over the window t+first … t+last instead of
        at one sample.
        """
        return replace(self, window=(first, last))

    def of_entry(self) -> Environment:
        """The environment for lowering an equation that an expression of this environment uses: the
        same time, but without the function arguments.

        An equation that a loss uses is lowered as in the step (R6).
        """
        # an equation means the same in a loss as in the step (R6); it does not see the arguments
        # of a function that uses it
        part = EnvironmentPart.STEP if self.part is EnvironmentPart.LOSS else self.part
        return replace(self, part=part, arguments={}, functions=())

    def inside(self, function: str, arguments: Mapping[str, FunctionArgument]) -> Environment:
        """The environment for lowering the formula of the function `function` at a call.
        `arguments` are those of the call, by the parameter names of the function.
        """
        return replace(self, arguments=arguments, functions=(*self.functions, function))

    def at_time_of(self, other: Environment) -> Environment:
        """This environment with the shift and window of `other`."""
        return replace(self, shift=other.shift, window=other.window)

    def without_stage(self) -> Environment:
        """This environment outside the integrator's stages: it reads states at t. Windows are read
        so, since they are constant within a step (R6).
        """
        return replace(self, stage=None)

    def at_start(self) -> Environment:
        """This environment in the start of a run, at t0, where samples are read from the log."""
        return self.in_graph_of(EnvironmentPart.START)

    def in_graph_of(self, part: EnvironmentPart) -> Environment:
        """This environment for lowering into the graph of another part of the program. It has no
        integrator stage, and its function arguments are lowered again.
        """
        # arguments are lowered again: their node ids so far belong to the previous graph
        arguments = {
            name: FunctionArgument(argument.expression, argument.environment.in_graph_of(part))
            for name, argument in self.arguments.items()
        }
        return replace(self, part=part, stage=None, arguments=arguments)

    @property
    def is_written(self) -> bool:
        """True if all arguments of the enclosing calls are expressions of the spec; False if one is
        a node that the compiler made.
        """
        return not any(
            argument.at_hand or not argument.environment.is_written
            for argument in self.arguments.values()
        )

    @property
    def is_elsewhere(self) -> bool:
        """True if the environment reads another sample than t, or a window."""
        return self.shift != 0 or self.window is not None

    @property
    def latest(self) -> int:
        """Offset from t of the latest sample that a signal is read at in this environment."""
        return self.shift + (self.window[1] if self.window is not None else 0)

    @property
    def time(self) -> Time:
        """Shift and window; the key under which already lowered values are found."""
        return self.shift, self.window


STEP = Environment(EnvironmentPart.STEP)
"""At t, in the step of a program."""
START = Environment(EnvironmentPart.START)
"""At t0, the start of a run."""
