"""Gives values a local variable: constants for parts of long expressions, arrays for the rest."""

from __future__ import annotations

from collections.abc import Sequence

from backends.c_language import tree as c
from backends.c_language.functions import FunctionTable
from backends.c_language.operations import expression_size
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope, LocalName, SpecName
from backends.c_language.used_names import used_names
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
        *,
        names_constants: bool = False,
    ) -> None:
        self.functions = functions
        self.notes = notes
        self.parallel_sums = parallel_sums
        """Partial sums of a long sum that grow side by side; more than 1 changes its order."""
        self.unroll = unroll
        """Elements up to which loops are written out."""
        self.block = block
        """Terms of a long sum that one turn of its loop adds."""
        self.names_constants = names_constants
        """Whether numbers that the spec names have their name in the text too."""
        self._known: dict[str, c.ConstantTable | c.Declare] = {}
        """By their names in the text: constants that statements may use."""
        self._units: dict[str, str] = {}
        """Of constants of the spec."""

    def name(self, node: Node, kind: str = "part") -> LocalName:
        """The spec's for what it names; for others one of the equation and their kind."""
        return SpecName(node.label) if node.label else self.notes.part_name(node, kind)

    def finished(self, node: Node, value: c.Expression, scope: BlockScope) -> c.Expression:
        """The expression, or a constant for it where the spec names it or it grows long."""
        # it has a name already, and a copy of it would say nothing
        if isinstance(value, c.Name):
            return value
        if node.label is None and expression_size(value) <= _LONGEST_EXPRESSION:
            return value
        self.notes.write(node, scope)
        return scope.constant(self.name(node), value, _c_type(node))

    def kept(self, node: Node, value: Value, name: LocalName, scope: BlockScope) -> ArrayView:
        """The value in a local of its own."""
        if node.label is not None and name == node.label:
            name = SpecName(node.label)
        boolean = node.type.kind == "bool"
        if node.type.size > 1:
            self.notes.write(node, scope)
            place = self.array(node, name, scope)
            copy_value(value, place, scope, self.unroll)
            return place
        indices = [Index()] * len(node.type.shape)
        # a scalar may have axes of length 1: an index for each
        made = value.make(indices, scope) if isinstance(value, Computed) else value.element(indices)
        # what the recipe has named by itself needs no second name
        if isinstance(value, ArrayView) or not isinstance(made, c.Name):
            self.notes.write(node, scope)
            made = scope.constant(name, made, _c_type(node))
        return ArrayView.single(made, boolean).reshaped_single(node.type.shape)

    def array(self, node: Node, name: LocalName, scope: BlockScope) -> ArrayView:
        """A new local array for the value, not yet filled."""
        return ArrayView.array(scope.array(name, node.type.size, _c_type(node)), node.type.shape)

    def constants(self, statements: Sequence[c.Statement]) -> tuple[c.Statement, ...]:
        """Constants that the statements use, to be declared before them."""
        used = used_names(statements)
        known = [(name, each) for name, each in self._known.items() if name in used]
        shown = [f"{name} [{self._units[name]}]" for name, _ in known if name in self._units]
        comment = (c.Comment(f"constants of the spec: {', '.join(shown)}"),) if shown else ()
        return (*comment, *(each for _, each in known))

    def known(
        self,
        values: tuple[float, ...],
        type: Type,
        name: LocalName,
        scope: BlockScope,
        *,
        of_spec: bool = False,
    ) -> ArrayView:
        """Numbers that stand in the text, in a table too once a loop runs over them.

        A number that the spec names is a constant of that name.
        """
        # by their bits: 0.0 and -0.0 compare equal and are two numbers
        if len({value.hex() for value in values}) == 1 and type.kind == "real":
            # equal numbers are one literal wherever they stand: no array, no index
            if not (of_spec and self.names_constants):
                return ArrayView.single(c.Real(values[0])).reshaped_single(type.shape)
            local = c.Name(scope.fresh(name))
            self._known[local.text] = c.Declare(
                c.CType.REAL, local.text, c.Real(values[0]), constant=True, static=True
            )
            if type.unit is not None:
                self._units[local.text] = type.unit.text
            return ArrayView.single(local).reshaped_single(type.shape)
        declared: list[c.Name] = []

        # declared at its first use: numbers that are read one by one are literals in the text
        def table() -> c.Expression:
            if not declared:
                declared.append(c.Name(scope.fresh(name)))
                self._known[declared[0].text] = c.ConstantTable(declared[0].text, values)
            return declared[0]

        return ArrayView.array(values, type.shape, table).of_kind(boolean=type.kind == "bool")


def _c_type(node: Node) -> c.CType:
    return c.CType.BOOL if node.type.kind == "bool" else c.CType.REAL
