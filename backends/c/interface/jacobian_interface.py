"""Plans the Jacobian in the header: its matrices, and the indices in its vectors."""

from __future__ import annotations

from dataclasses import dataclass

from backends.c_language.places import ArrayView, c_strides, variable
from backends.c_language.rendering import comment_text
from backends.c_language.tree import Name
from backends.c_lowering.options import COptions
from backends.c_lowering.state_memory import member_place
from backends.ports.identifiers import c_identifier
from compiler.ir.program import Program
from compiler.ir.types import WINDOW
from compiler.jacobian.jacobian import jacobian
from compiler.jacobian.matrices import Jacobian, Matrix, Member, Vector

OUT = "jac"
"""The argument of the generated function that receives the matrices."""

_MEANING = {
    "x": "x: what the model remembers from step to step",
    "u": "u: inputs of a step",
    "y": "y: outputs of a step",
    "p": "p: parameters of a step",
}
_DECLARED = "x: the declared states; samples in buffers are none of them"
_ROW = {"x": "x of the next step", "y": "y"}


@dataclass(frozen=True, slots=True)
class MatrixField:
    """A matrix of the Jacobian as a field of the C struct `jac`, in row-major order. `columns` is
    like `rows`.
    """

    matrix: Matrix
    rows: str
    """The macro for the number of rows, or the number if their vector has no names."""
    columns: str

    @property
    def extent(self) -> str:
        """The number of its entries, as a C expression."""
        return f"{self.rows} * {self.columns}"

    @property
    def identifier(self) -> str:
        return self.matrix.name

    @property
    def place(self) -> ArrayView:
        """The view of all entries of the field, by row-major index."""
        return member_place(OUT, self.identifier, (self.matrix.size,))

    @property
    def comment(self) -> str:
        rows, columns = self.matrix.shape
        by = self.matrix.columns.letter
        return f"d {_ROW[self.matrix.rows.letter]} / d {by}: {rows} x {columns}, row after row"


@dataclass(frozen=True, slots=True)
class FirstPlace:
    """A C macro whose value is the index of a quantity's first element in a vector of the
    Jacobian.
    """

    name: str
    """Name of the quantity in the spec."""
    macro: str
    first: int
    comment: str


@dataclass(frozen=True, slots=True, kw_only=True)
class VectorNames:
    """A vector of the Jacobian (`letter` x, u, y or p) in the header: `count` is the macro of its
    length `size`, `places` the macros of the first index of each quantity.
    """

    letter: str
    count: str
    size: int
    comment: str
    places: tuple[FirstPlace, ...]

    def has(self, name: str) -> bool:
        """True if the vector contains the quantity."""
        return any(place.name == name for place in self.places)

    def place(self, base: str, name: str, shape: tuple[int, ...]) -> ArrayView:
        """The elements of the quantity `name`, in this shape, as a view of the C array `base`.
        Raises StopIteration for a quantity that is not in the vector.
        """
        macro = next(place.macro for place in self.places if place.name == name)
        return ArrayView(Name(base), shape, c_strides(shape), variable(macro))


@dataclass(frozen=True, slots=True)
class JacobianInterface:
    """The Jacobian of a program, with its nonempty matrices and its vectors as the header declares
    them.
    """

    jacobian: Jacobian
    fields: tuple[MatrixField, ...]
    vectors: tuple[VectorNames, ...]


def jacobian_interface(
    program: Program, options: COptions, prefix: str
) -> JacobianInterface | None:
    """The Jacobian of a program with its names in C; None if the options have no `extras` and so do
    not request it. `prefix` is that of all C names.
    """
    if not options.extras:
        return None
    by_parameters = "parameter_jacobian" in options.extras
    declared_only = "state_jacobian" in options.extras
    found = jacobian(
        program,
        parameters=by_parameters,
        declared_only=declared_only,
        feedthrough_only="feedthrough" in options.extras,
    )
    vectors = [found.states, found.inputs, found.outputs]
    # inlined parameters have no struct that could be copied to a vector
    if by_parameters and options.params != "inline":
        vectors.append(found.parameters)
    # C has no empty arrays
    filled = [matrix for matrix in found.matrices if matrix.size]
    used = {vector.letter for matrix in filled for vector in (matrix.rows, matrix.columns)}
    meaning = _MEANING | ({"x": _DECLARED} if declared_only else {})
    names = tuple(
        _names(vector, prefix, meaning[vector.letter])
        for vector in vectors
        if vector.letter in used
    )
    counts = {vector.letter: vector.count for vector in names}

    def count(vector: Vector) -> str:
        return counts.get(vector.letter, f"{vector.size}U")

    fields = tuple(
        MatrixField(matrix, count(matrix.rows), count(matrix.columns)) for matrix in filled
    )
    return JacobianInterface(found, fields, names)


def _names(vector: Vector, prefix: str, meaning: str) -> VectorNames:
    begin = f"{prefix}_{vector.letter}".upper()
    taken: set[str] = set()
    # upper case before names are made unique: `Kp` and `kp` would be the same macro
    places = tuple(
        FirstPlace(
            member.name,
            f"{begin}_{c_identifier(member.name.upper(), taken)}",
            member.first,
            _described(member),
        )
        for member in vector.members
    )
    count = f"{prefix}_n{vector.letter}".upper()
    return VectorNames(
        letter=vector.letter, count=count, size=vector.size, comment=meaning, places=places
    )


def _described(member: Member) -> str:
    unit = f" [{member.unit.text}]" if member.unit is not None else ""
    sizes = " x ".join(
        f"{'t' if a.name == WINDOW else a.name or '_'} {a.size}" for a in member.axes
    )
    return comment_text(f"{member.name}{unit}" + (f", {sizes}" if sizes else ""))
