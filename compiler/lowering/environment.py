"""Describes the place of an expression: the part of the program, the time, the enclosing call."""

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
    """The part of a program that contains an expression; it decides the meaning of names (R6)."""

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
    """A stage of an integrator within a step, at which a right-hand side is evaluated (R6).

    Two stages are never equal.
    """

    values: Mapping[str, NodeId]
    """Values of the integrated states at this stage, by name."""
    fraction: Fraction
    """Elapsed fraction of the step: 0 at sample t, 1 at sample t+1."""
    owner: str = ""
    """The sub-model whose states are integrated; "" for the model itself."""


@dataclass(frozen=True, eq=False)
class FunctionArgument:
    """An argument of a function of the spec, whose formula replaces the call.

    It becomes a node where the formula uses it, once for each time in `lowered`.
    """

    expression: Expression
    environment: Environment
    lowered: dict[Time, NodeId] = field(default_factory=dict["Time", NodeId])
    at_hand: bool = False
    """True if the value exists already as a node; the expression is only its name."""


@dataclass(frozen=True, eq=False)
class Environment:
    """Where an expression is: graph, time, integrator stage and enclosing calls, which decide what
    its names mean.
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
        """The environment for reading every signal `samples` later; negative for earlier."""
        return replace(self, shift=self.shift + samples)

    def over(self, first: int, last: int) -> Environment:
        """The environment in which every signal is read over the window t+first … t+last."""
        return replace(self, window=(first, last))

    def of_entry(self) -> Environment:
        """The environment for lowering an equation that is used here: same time, but without the
        function arguments.

        An equation used in a loss means the same as in the step (R6).
        """
        # an equation means the same in a loss as in the step (R6); it does not see the arguments
        # of a function that uses it
        part = EnvironmentPart.STEP if self.part is EnvironmentPart.LOSS else self.part
        return replace(self, part=part, arguments={}, functions=())

    def inside(self, function: str, arguments: Mapping[str, FunctionArgument]) -> Environment:
        """The environment for lowering the formula of a function at its call, with the call's
        arguments.
        """
        return replace(self, arguments=arguments, functions=(*self.functions, function))

    def at_time_of(self, other: Environment) -> Environment:
        """This environment with the shift and window of another one."""
        return replace(self, shift=other.shift, window=other.window)

    def without_stage(self) -> Environment:
        """This environment with the states at t: windows are constant within an integrator step
        (R6).
        """
        return replace(self, stage=None)

    def at_start(self) -> Environment:
        """This environment at the start of a run: samples before t0 are read from the log."""
        return self.in_graph_of(EnvironmentPart.START)

    def in_graph_of(self, part: EnvironmentPart) -> Environment:
        """This environment for lowering into the graph of another part of the program, such as the
        start.
        """
        # arguments are lowered again: their node ids so far belong to the previous graph
        arguments = {
            name: FunctionArgument(argument.expression, argument.environment.in_graph_of(part))
            for name, argument in self.arguments.items()
        }
        return replace(self, part=part, stage=None, arguments=arguments)

    @property
    def is_written(self) -> bool:
        """True if all arguments of the enclosing calls are expressions of the spec, not nodes made
        by the compiler.
        """
        return not any(
            argument.at_hand or not argument.environment.is_written
            for argument in self.arguments.values()
        )

    @property
    def is_elsewhere(self) -> bool:
        """True unless the environment is the single sample at t."""
        return self.shift != 0 or self.window is not None

    @property
    def latest(self) -> int:
        """Offset from t of the last sample of the environment."""
        return self.shift + (self.window[1] if self.window is not None else 0)

    @property
    def time(self) -> Time:
        """Shift and window, the key of values that were lowered already."""
        return self.shift, self.window


STEP = Environment(EnvironmentPart.STEP)
"""At t, in the step of a program."""
START = Environment(EnvironmentPart.START)
"""At t0, the start of a run."""
