"""Gives values a local variable: constants for parts of long expressions, arrays for the rest."""

from __future__ import annotations

from backends.c_language.functions import FunctionTable
from backends.c_language.operations import expression_size
from backends.c_language.places import Index, Place
from backends.c_language.scope import Scope
from backends.c_language.tree import CType, Expression, Name, Real, Table
from backends.c_lowering.spec_notes import SpecNotes
from backends.c_lowering.values import Computed, Value, copy_value
from compiler.ir.program import Node
from compiler.ir.types import Type

_LONGEST_EXPRESSION = 5
"""Operations in one statement; more than that get a name."""


class LocalValues:
    """Writes the locals of one function."""

    def __init__(
        self,
        functions: FunctionTable,
        notes: SpecNotes,
        unroll: int,
        parallel_sums: int = 1,
        block: int = 1,
    ) -> None:
        self.functions = functions
        self.notes = notes
        self.parallel_sums = parallel_sums
        """Partial sums of a long sum that grow side by side; more than 1 changes its order."""
        self.unroll = unroll
        """Elements up to which loops are written out."""
        self.block = block
        """Terms of a long sum that one turn of its loop adds."""
        self.tables: list[Table] = []
        """Constant arrays that the statements use: to be declared before them."""

    def name(self, node: Node) -> str:
        return node.label or self.notes.part_name(node, "part")

    def finished(self, node: Node, value: Expression, scope: Scope) -> Expression:
        """The expression, or a constant for it where the spec names it or it grows long."""
        if isinstance(value, Name):
            return value
        if node.label is None and expression_size(value) <= _LONGEST_EXPRESSION:
            return value
        self.notes.write(node, scope)
        return scope.constant(self.name(node), value, _c_type(node))

    def kept(self, node: Node, value: Value, name: str, scope: Scope) -> Place:
        """The value in a local of its own."""
        boolean = node.type.kind == "bool"
        if node.type.size > 1:
            self.notes.write(node, scope)
            place = self.array(node, name, scope)
            copy_value(value, place, scope, self.unroll)
            return place
        indices = [Index()] * len(node.type.shape)
        made = value.make(indices, scope) if isinstance(value, Computed) else value.element(indices)
        if isinstance(value, Place) or not isinstance(made, Name):
            self.notes.write(node, scope)
            made = scope.constant(name, made, _c_type(node))
        return Place.single(made, boolean).reshaped_single(node.type.shape)

    def array(self, node: Node, name: str, scope: Scope) -> Place:
        """A new local array for the value, not yet filled."""
        return Place.array(scope.array(name, node.type.size, _c_type(node)), node.type.shape)

    def known(self, values: tuple[float, ...], type: Type, name: str, scope: Scope) -> Place:
        """Numbers that stand in the text, in a table too once a loop runs over them."""
        if len({value.hex() for value in values}) == 1 and type.kind == "real":
            return Place.single(Real(values[0])).reshaped_single(type.shape)
        declared: list[Name] = []

        def table() -> Expression:
            if not declared:
                declared.append(Name(scope.fresh(name)))
                self.tables.append(Table(declared[0].text, values))
            return declared[0]

        return Place.array(values, type.shape, table).of_kind(boolean=type.kind == "bool")


def _c_type(node: Node) -> CType:
    return CType.BOOL if node.type.kind == "bool" else CType.REAL
