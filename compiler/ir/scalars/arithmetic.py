"""Declares the operations in which derivatives and definitions of scalar functions are written."""

from __future__ import annotations

from typing import Protocol, TypeVar

V = TypeVar("V")
W = TypeVar("W", contravariant=True)


class InfiniteFacts(Protocol[W]):
    """Decides which values can be infinite and which can be 0."""

    def can_be_infinite(self, value: W, /) -> bool: ...
    def divides(self, value: W, /) -> bool: ...
    def is_never_zero(self, value: W, /) -> bool: ...


class Arithmetic(Protocol[V]):
    """Arithmetic on values of one kind: nodes of a graph, or floats in a test."""

    def constant(self, value: float, /) -> V: ...
    def add(self, left: V, right: V, /) -> V: ...
    def subtract(self, left: V, right: V, /) -> V: ...
    def multiply(self, left: V, right: V, /) -> V: ...
    def divide(self, left: V, right: V, /) -> V: ...
    def negate(self, value: V, /) -> V: ...

    def apply(self, function: str, /, *args: V) -> V:
        """Applies the scalar function of that name."""
        ...

    def where_negative(self, value: V, then: V, otherwise: V, /) -> V:
        """`then` where the value is below 0, otherwise (also for NaN) `otherwise`."""
        ...

    @property
    def infinite_values(self) -> InfiniteFacts[V]:
        """Facts about values, so that only possibly infinite ones are tested."""
        ...

    def zero_with(self, factor: V, product: V, /) -> V:
        """0 where the factor is 0, otherwise the product. A NaN factor does not count as 0."""
        ...
