"""Marks an input of a sub-model that an expression feeds."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import PlainValidator

from spec_schema.sections.signals import Equation, Signal


class Connected(Equation):
    """An equation that has the place of an input: its declared unit and dims, at every time.

    `declared_in` is the sub-model whose file has the connection, "" for the model itself.
    """

    input: Annotated[Any, PlainValidator(lambda signal: signal)]
    declared_in: str

    @property
    def feeds(self) -> Signal:
        """The declaration of the input."""
        assert isinstance(self.input, Signal)
        return self.input

    def is_held_for(self, owner: str) -> bool:
        """Whether it keeps its value over a step in which the states of `owner` are integrated.

        From outside a sub-model its inputs are samples; within one, values in between (R6).
        """
        inside = not owner or self.declared_in == owner
        return not (inside or self.declared_in.startswith(f"{owner}."))
