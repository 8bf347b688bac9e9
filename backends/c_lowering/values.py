"""Represents values of nodes in C: places in memory, expressions at their use, local variables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from backends.c_language import tree as c
from backends.c_language.functions import FunctionTable, expression_size
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope, LocalName, SpecName
from backends.c_language.tree import Expression, used_names
from backends.c_lowering.spec_notes import SpecNotes
from compiler.ir.program import Node
from compiler.ir.types import Type

Indices = Sequence[Index]
Finish = Callable[[Expression, BlockScope], Expression]


@dataclass(frozen=True, slots=True)
class Computed:
    """A value that is not in memory. `make(indices, scope)` writes the statements for one element
    into a block and returns the element's C expression. It is called once per element.
    """

    shape: tuple[int, ...]
    make: Callable[[Indices, BlockScope], Expression]
    """The element's expression; what it needs has been written into the block."""
    depth: int
    """Recipes inside one another, this one included."""
    finish: Finish | None = None
    """Gives the expression a name where it is to be a part of another one."""

    def element(self, indices: Indices, scope: BlockScope) -> Expression:
        made = self.make(indices, scope)
        return made if self.finish is None else self.finish(made, scope)


Value = ArrayView | Computed


def element_of(value: Value, indices: Indices, scope: BlockScope) -> Expression:
    """The C expression of one element, as part of a larger expression. Statements that it needs are
    written to `scope`.
    """
    if isinstance(value, ArrayView):
        return value.element(indices)
    return value.element(indices, scope)


def copy_value(value: Value, target: ArrayView, scope: BlockScope, unroll: int) -> None:
    """Writes statements that copy all elements of a value to the place `target`; as loops if there
    are more than `unroll`.
    """

    def one(indices: tuple[Index, ...], inner: BlockScope) -> None:
        if isinstance(value, ArrayView):
            made = value.element(indices)
        else:
            # not `element`, whose finish would name what gets its name from the target
            made = value.make(indices, inner)
        inner.assign(target.element(indices), made)

    scope.each(target.shape, unroll, one)


def depth_of(value: Value) -> int:
    return value.depth if isinstance(value, Computed) else 0


def repeated(value: Value, old: Type, new: Type) -> Value:
    """The value repeated along axes that `new`, the type after a broadcast, has and `old` does
    not.
    """
    kept = [old.axis_names.index(n) if n in old.axis_names else None for n in new.axis_names]
    if isinstance(value, ArrayView):
        return value.repeated(new.shape, kept)

    # the indices of the old axes among those of the new; a repeated axis has none
    def moved(indices: Indices) -> Indices:
        # index 0 stays for axes of size 1 that the new shape lacks
        result = [Index()] * len(old.shape)
        for index, axis in zip(indices, kept, strict=True):
            if axis is not None:
                result[axis] = index
        return result

    return _seen_through(value, new.shape, moved)


def sliced(value: Value, axis: int, start: int, stop: int) -> Value:
    """The elements start … stop−1 of a value along the axis with this position."""
    if isinstance(value, ArrayView):
        return value.sliced(axis, start, stop)

    def moved(indices: Indices) -> Indices:
        return [*indices[:axis], indices[axis].plus(Index(start)), *indices[axis + 1 :]]

    return _seen_through(
        value, (*value.shape[:axis], stop - start, *value.shape[axis + 1 :]), moved
    )


def with_units_moved(value: Computed, old: tuple[int, ...], new: tuple[int, ...]) -> Computed:
    """The value with shape `new` instead of `old`; both differ in axes of length 1 only."""

    def moved(indices: Indices) -> Indices:
        longer = iter([i for i, size in zip(indices, new, strict=True) if size != 1])
        return [Index() if size == 1 else next(longer) for size in old]

    return _seen_through(value, new, moved)


def _seen_through(
    value: Computed, shape: tuple[int, ...], moved: Callable[[Indices], Indices]
) -> Computed:
    def make(indices: Indices, scope: BlockScope) -> Expression:
        return value.element(moved(indices), scope)

    return Computed(shape, make, value.depth + 1)


_LONGEST_EXPRESSION = 5
"""Maximum number of operations in one statement; longer expressions are split."""


class LocalValues:
    """Declares the local variables and constants of one C function, with names from the spec where
    possible. `functions` and `notes` write calls and comments.
    """

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
        """Number of partial sums of a long sum; more than 1 changes the order of summation."""
        self.unroll = unroll
        """Maximum number of elements for which loops are unrolled."""
        self.block = block
        """Terms of a long sum per iteration of its loop."""
        self.names_constants = names_constants
        """True if constants that the spec names have their name in C as well."""
        self._known: dict[str, c.ConstantTable | c.Declare] = {}
        """Constants that statements may use, by name in C."""
        self._units: dict[str, str] = {}
        """Units of constants of the spec."""

    def name(self, node: Node, kind: str = "part") -> LocalName:
        """The name for a local variable: the name of the node in the spec; otherwise one from its
        equation and `kind`, such as `drag_part`.
        """
        return SpecName(node.label) if node.label else self.notes.part_name(node, kind)

    def finished(self, node: Node, value: c.Expression, scope: BlockScope) -> c.Expression:
        """The expression itself, or a new local constant with its value if the spec names the node
        or the expression is long.
        """
        # it already has a name
        if isinstance(value, c.Name):
            return value
        if node.label is None and expression_size(value) <= _LONGEST_EXPRESSION:
            return value
        self.notes.write(node, scope)
        return scope.constant(self.name(node), value, _c_type(node))

    def kept(self, node: Node, value: Value, name: LocalName, scope: BlockScope) -> ArrayView:
        """Writes the value of a node into a new local variable called `name`, and returns its
        place. A scalar that has a name in C already gets no second one.
        """
        if node.label is not None and name == node.label:
            name = SpecName(node.label)
        boolean = node.type.kind == "bool"
        if node.type.size > 1:
            self.notes.write(node, scope)
            place = self.array(node, name, scope)
            copy_value(value, place, scope, self.unroll)
            return place
        indices = [Index()] * len(node.type.shape)
        # a scalar may have axes of length 1, which need indices
        made = value.make(indices, scope) if isinstance(value, Computed) else value.element(indices)
        # a value that is already named needs no second name
        if isinstance(value, ArrayView) or not isinstance(made, c.Name):
            self.notes.write(node, scope)
            made = scope.constant(name, made, _c_type(node))
        return ArrayView.single(made, boolean).reshaped_single(node.type.shape)

    def array(self, node: Node, name: LocalName, scope: BlockScope) -> ArrayView:
        """Declares an uninitialised local array called `name` with the node's shape, and returns
        its place.
        """
        return ArrayView.array(scope.array(name, node.type.size, _c_type(node)), node.type.shape)

    def constants(self, statements: Sequence[c.Statement]) -> tuple[c.Statement, ...]:
        """Declarations of those constants that the statements use, after a comment with the units
        of constants of the spec.
        """
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
        """The place of a constant array with these values in C order. Elements with a constant
        index become literals; a table called `name` is declared only if a loop reads it. With
        `of_spec`, a scalar becomes a C constant of that name if the function names constants.
        """
        # compared by their bits, since 0.0 == -0.0
        if len({value.hex() for value in values}) == 1 and type.kind == "real":
            # equal elements are one literal without array or index
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

        # declared at its first use in a loop: elements with constant index are literals
        def table() -> c.Expression:
            if not declared:
                declared.append(c.Name(scope.fresh(name)))
                self._known[declared[0].text] = c.ConstantTable(declared[0].text, values)
            return declared[0]

        return ArrayView.array(values, type.shape, table).of_kind(boolean=type.kind == "bool")


def _c_type(node: Node) -> c.CType:
    return c.CType.BOOL if node.type.kind == "bool" else c.CType.REAL
