"""Texts shared by tables and plots of validations."""

from __future__ import annotations

from typing import Protocol

from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit


class Simulated(Protocol):
    """An object with the kind of simulation that was evaluated: horizon, closed signals,
    details.
    """

    @property
    def horizon(self) -> str: ...

    @property
    def closed(self) -> tuple[str, ...]: ...

    @property
    def details(self) -> tuple[str, ...]: ...


def rollout_text(row: Simulated) -> str:
    """The text of a simulation: `one step`, `50 steps, closing x`, `record, skip 20`.

    Different simulations or scorings have different texts.
    """
    steps = f"{row.horizon} steps" if row.horizon.isdecimal() else row.horizon
    closed = [f"closing {', '.join(row.closed)}"] if row.closed else []
    return ", ".join(["one step" if row.horizon == "1" else steps, *closed, *row.details])


class ValidationRow(Simulated, Protocol):
    """An object with an output or loss, its kind of simulation and its data set."""

    @property
    def of(self) -> str: ...

    @property
    def data(self) -> str: ...


def measured_as(row: ValidationRow) -> tuple[str, str, str]:
    """Key of a measurement: the output, the text of its simulation, and the data."""
    return row.of, rollout_text(row), row.data


def unit_text(unit: Unit | None) -> str:
    """The text of a unit as the user wrote it; empty if None."""
    return "" if unit is None else unit.text


def difference_text(number: str, unit: Unit | None) -> str:
    """A difference with its unit if it differs from the row's: K in a row of degC."""
    own = unit_text(unit and unit.difference)
    return f"{number} {own}" if number and own != unit_text(unit) else number


def unit_of_record(text: str | None) -> Unit | None:
    """The unit that a JSON record of a run names by its text; None if there is none."""
    return parse_unit(text) if text else None
