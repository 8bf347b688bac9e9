"""Defines what stands after the dot of a part that a feature brings: `arm.mass_matrix(q)`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeAlias, TypeVar

from compiler.ir.program import NodeId
from compiler.linking.link import LinkedPart
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.expressions.tree import Call, Member
from spec_schema.late_dataclass import dataclass
from spec_schema.registry import PartLine

M = TypeVar("M")


@dataclass(frozen=True, kw_only=True)
class PartMembers(Generic[M]):
    """The members of a kind of parts: `M` is the class of what is read of its file."""

    call: Callable[[Context, LinkedPart[M], Call, Environment], NodeId]
    """The node of a call of a member; LoweringFailed once its mistakes are reported."""
    unknown: Callable[[LinkedPart[M], Member], Diagnostic]
    """The report of a member that is no value by itself, or is not there."""


AnyPartMembers: TypeAlias = PartMembers[Any]


def members_of(line: PartLine) -> AnyPartMembers:
    """The members of a line of the registry, imported when a spec has such a part."""
    members: AnyPartMembers = line.members.value
    return members
