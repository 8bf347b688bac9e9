"""Says where an expression stands: the part of the program, the time, the call around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from enum import Enum
from fractions import Fraction

from compiler.ir.program import NodeId
from spec_schema.expressions.tree import Expression
from spec_schema.late_dataclass import dataclass

Time = tuple[int, tuple[int, int] | None]
"""Shift and window: when an expression is evaluated, seen from t."""


class EnvironmentPart(Enum):
    """The part of a program that an expression is in; it decides what a bare name means (R6)."""

    STEP = "the step"
    """An input is what the step sees, a state its simulated value."""
    LOSS = "a loss"
    """A bare input is its log; equations inside mean what they mean in the step."""
    START = "an initial value"
    """Evaluated once, at t0, over the log; the simulation does not exist yet (R7)."""
    CONSTANT = "a constant"
    """Evaluated by the compiler: nothing may be read."""


@dataclass(frozen=True, eq=False)
class IntegratorStage:
    """The place within a step where a right-hand side is evaluated (R6); equal only to itself."""

    values: Mapping[str, NodeId]
    """Of the continuous states that are integrated."""
    fraction: Fraction
    """The part of the step that is over: 0 at sample t, 1 at sample t+1."""
    owner: str = ""
    """The sub-model whose states are integrated; "" for those of the model itself."""


@dataclass(frozen=True, eq=False)
class FunctionArgument:
    """An argument of an inlined function: lowered where it is used, once a time."""

    expression: Expression
    environment: Environment
    lowered: dict[Time, NodeId] = field(default_factory=dict["Time", NodeId])
    at_hand: bool = False
    """Whether it is a value that a layer has, and the expression but a name for it."""


@dataclass(frozen=True, eq=False)
class Environment:
    """Everything besides the expression that its meaning depends on."""

    part: EnvironmentPart
    shift: int = 0
    """Samples that every signal is read later (negative: earlier) than written: `e[t-3]`."""
    window: tuple[int, int] | None = None
    """First and last sample of the time window that the expression is evaluated over."""
    stage: IntegratorStage | None = None
    arguments: Mapping[str, FunctionArgument] = field(default_factory=dict[str, FunctionArgument])
    functions: tuple[str, ...] = ()
    """Functions being inlined, outermost first."""

    def shifted(self, samples: int) -> Environment:
        return replace(self, shift=self.shift + samples)

    def over(self, first: int, last: int) -> Environment:
        return replace(self, window=(first, last))

    def of_entry(self) -> Environment:
        """The environment of an equation used here: same time, no arguments, the step's names."""
        # what a model computes does not change because a loss looks at it (R6); and a formula of
        # the spec does not see the arguments of the function that names it
        part = EnvironmentPart.STEP if self.part is EnvironmentPart.LOSS else self.part
        return replace(self, part=part, arguments={}, functions=())

    def inside(self, function: str, arguments: Mapping[str, FunctionArgument]) -> Environment:
        """The environment of a function's formula that is inlined here."""
        return replace(self, arguments=arguments, functions=(*self.functions, function))

    def at_time_of(self, other: Environment) -> Environment:
        """This place at another place's time."""
        return replace(self, shift=other.shift, window=other.window)

    def without_stage(self) -> Environment:
        """Windows are held over a step of the integrator (R6): the states as they are at t."""
        return replace(self, stage=None)

    def at_start(self) -> Environment:
        """This place in the start of a run: what it reads before t0 is evaluated over the log."""
        return self.in_graph_of(EnvironmentPart.START)

    def in_graph_of(self, part: EnvironmentPart) -> Environment:
        """This place in another graph."""
        # arguments are lowered where the call stands, which is there now; what was lowered of them
        # before are numbers of the graph that is left
        arguments = {
            name: FunctionArgument(argument.expression, argument.environment.in_graph_of(part))
            for name, argument in self.arguments.items()
        }
        return replace(self, part=part, stage=None, arguments=arguments)

    @property
    def is_written(self) -> bool:
        """Whether its arguments, and what those stand in, are expressions of the spec."""
        return not any(
            argument.at_hand or not argument.environment.is_written
            for argument in self.arguments.values()
        )

    @property
    def is_elsewhere(self) -> bool:
        """Whether anything but the one sample at t is meant."""
        return self.shift != 0 or self.window is not None

    @property
    def latest(self) -> int:
        """Samples after t of the last one that is meant."""
        return self.shift + (self.window[1] if self.window is not None else 0)

    @property
    def time(self) -> Time:
        """The time part, for remembering what was lowered already."""
        return self.shift, self.window


STEP = Environment(EnvironmentPart.STEP)
"""At t, in the step of a program."""
START = Environment(EnvironmentPart.START)
"""At t0, where a run starts."""
