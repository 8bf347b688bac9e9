"""Translates the functions of a saved model, each as one formula or separately per call."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msnn.features.nnodely import arrays
from msnn.features.nnodely.arrays import Elements
from msnn.features.nnodely.errors import untranslated
from msnn.features.nnodely.followed_python.python_function import (
    FunctionError,
    argument_names,
    follow,
    parse_function,
    refuse_mixed_rows,
    with_arguments_last,
)
from msnn.features.nnodely.followed_python.torch_calls import NeedsElementsError, Tensor, Whole
from msnn.features.nnodely.json_text import JsonText
from msnn.features.nnodely.names import TakenNames
from msnn.features.nnodely.parameters import Parameters
from msnn.features.nnodely.saved_model import File, Function
from msnn.features.nnodely.terms import (
    Call,
    Named,
    Term,
    after_operands,
    joined,
    minus,
    number,
    text_of_whole,
)
from msnn.features.nnodely.values import ShapeError, Value, ValueOperations, one_piece
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.diagnostics.source import Span

_LONGEST = 40
"""Maximum number of operations of a formula written as a function of the spec."""


class NotRecognisedError(Exception):
    """A recognised group of relations cannot be translated as a whole; its relations are translated
    one by one.
    """


@dataclass(frozen=True, slots=True)
class Formula:
    """A function that the spec declares: the names of its arguments, and its formula as text."""

    args: tuple[str, ...]
    text: str


@dataclass(slots=True, kw_only=True)
class Functions:
    """Translates functions of the saved model to formulas of the spec; `declared` collects those
    that become functions of the spec, by name.
    """

    file: File
    text: JsonText
    names: TakenNames
    parameters: Parameters
    values: ValueOperations
    declared: dict[str, Formula] = field(default_factory=dict[str, Formula])
    _formulas: dict[tuple[Any, ...], str | None] = field(
        default_factory=dict[tuple[Any, ...], "str | None"]
    )
    _separate: set[tuple[Any, ...]] = field(default_factory=set[tuple[Any, ...]])
    """Functions known not to mix rows, by the shapes of their arguments."""
    _shapes: dict[tuple[Any, ...], tuple[int, ...]] = field(
        default_factory=dict[tuple[Any, ...], "tuple[int, ...]"]
    )

    def called(self, key: str, operands: Sequence[Value | str], relation: str) -> Value:
        """The value of a call of the function `key` of the file. An operand is the value of a
        stream or the name of a matrix; `relation` is the calling relation, for messages.

        Raises ShapeError if the file lacks the function or one of its arrays, SpecError for code
        that is not supported.
        """
        given = self.file.Functions.get(key)
        if given is None or given.code is None or given.name is None:
            raise ShapeError(f"`{key}` is no function of the file")
        place = (key, "code")
        function = self._parsed(place, given.code, given.name)
        # with a list torch.vmap calls the function: its arguments come without the batch
        batched = not isinstance(given.map_over_dim, list)
        streams = [one for one in operands if isinstance(one, Value)]
        matrices = [one for one in operands if isinstance(one, str)]
        arrays_of = [*matrices, *self._own_arrays(relation, given)]
        known: Any = key
        try:
            if matrices:
                last = tuple(isinstance(one, str) for one in operands)
                function, known = with_arguments_last(function, last), (key, last)
            return self._followed(function, known, streams, arrays_of, batched=batched)
        except FunctionError as fault:
            raise self._refused(f"Functions.{key}", place, given.code, fault) from None

    def of_sets(self, key: str, streams: Sequence[Value], own: Sequence[Term], size: int) -> Value:
        """The values of the function `key` in the cells of a local model, as one value with `size`
        elements.

        `streams` are its scalar arguments; `own` are its parameters, each with one element per set.
        Raises NotRecognisedError if it cannot be one formula, SpecError if its code is not a
        function.
        """
        given = self.file.Functions[key]
        function = self._parsed((key, "code"), given.code or "", given.name or "")
        wholes = [Whole(v.pieces[0], (1, v.window, v.dim)) for v in streams]
        if any(len(v.pieces) > 1 or v.window * v.dim > 1 for v in streams):
            raise NotRecognisedError
        wholes.extend(Whole(term, (1,)) for term in own)
        try:
            name = self._formula(function, (key, "sets"), wholes)
        except (FunctionError, NeedsElementsError):
            raise NotRecognisedError from None
        if name is None:
            raise NotRecognisedError
        term = joined(Call(name), *(whole.term for whole in wholes), dim=size)
        return one_piece(term)

    def of_offset(self, key: str) -> str | None:
        """The name of the spec's function that gives the membership from the distance to the
        centre. None if its formula cannot be one function of the spec. Raises SpecError for
        unsupported code.
        """
        code, name, place = self._membership(key, 0)
        function = self._parsed(place, code, name)
        try:
            return self._formula(function, (key, 0), [Whole(number(0), (1, 1, 1))])
        except NeedsElementsError:
            return None
        except FunctionError as fault:
            raise self._refused(f"Functions.{key}", place, code, fault) from None

    def membership(self, key: str, index: int, center: float, value: Value) -> Value:
        """The membership of `value` in the fuzzy set `index` of the function `key`, whose centre is
        `center`. Used if the sets have different functions. Raises ShapeError without a function,
        SpecError for unsupported code.
        """
        code, name, place = self._membership(key, index)
        function = self._parsed(place, code, name)
        offset = self.values.elementwise(minus, value, one_piece(number(center)))
        try:
            return self._followed(function, (key, index), [offset], [], batched=True)
        except FunctionError as fault:
            raise self._refused(f"Functions.{key}", place, code, fault) from None

    def _membership(self, key: str, index: int) -> tuple[str, str, tuple[str | int, ...]]:
        given = self.file.Functions[key]
        codes, names = given.functions, given.names
        if isinstance(codes, list) and isinstance(names, list) and len(codes) == len(names) > 0:
            # nnodely goes round a list of functions that is shorter than its sets
            which = index % len(codes)
            return codes[which], names[which], (key, "functions", which)
        if isinstance(codes, str) and isinstance(names, str):
            return codes, names, (key, "functions")
        raise ShapeError(f"the fuzzy sets of `{key}` have no functions")

    def _parsed(self, place: tuple[str | int, ...], code: str, name: str) -> ast.FunctionDef:
        try:
            return parse_function(code, name)
        except FunctionError as fault:
            raise self._refused(f"Functions.{place[0]}", place, code, fault) from None

    def _own_arrays(self, relation: str, given: Function) -> list[str]:
        for name in given.params_and_consts:
            if not self.parameters.has(name):
                raise ShapeError(f"`{name}` of `{relation}` is no parameter of the file")
        return given.params_and_consts

    def _followed(
        self,
        function: ast.FunctionDef,
        key: Any,
        streams: Sequence[Value],
        own: Sequence[str],
        *,
        batched: bool,
    ) -> Value:
        shapes = tuple((value.window, value.dim) for value in streams)
        # nnodely calls with a batch: a function that mixes its rows is none of one sample
        if batched and (key, shapes, *own) not in self._separate:
            refuse_mixed_rows(function, shapes, [self.parameters.elements(name) for name in own])
            self._separate.add((key, shapes, *own))
        try:
            # whole windows give formulas that people read; element by element is what always works
            made = self._by_wholes(function, key, streams, own, batched=batched)
        except NeedsElementsError:
            made = None
        if made is not None:
            return made
        front = (1,) if batched else ()
        given: list[Tensor] = [self._elements(value, front) for value in streams]
        given.extend(self.parameters.elements(name) for name in own)
        found = follow(function, given)
        assert not isinstance(found, Whole)
        return self._put_together(function, found if batched else found[None])

    def _by_wholes(
        self,
        function: ast.FunctionDef,
        key: Any,
        streams: Sequence[Value],
        own: Sequence[str],
        *,
        batched: bool,
    ) -> Value | None:
        """The result of a function on complete windows and arrays (`own`, by name); None if it must
        be evaluated element by element. `batched` says whether arguments have a leading batch axis
        of 1.
        """
        front = (1,) if batched else ()
        windows = {value.window for value in streams} - {1}
        if any(len(value.pieces) > 1 for value in streams) or len(windows) > 1:
            return None
        wholes = [Whole(v.pieces[0], (*front, v.window, v.dim)) for v in streams]
        for name in own:
            found = self.parameters.numbers(name)
            shape = found.values.shape
            # an array goes with whole windows where its axis is theirs, or where it is one row
            runs = found.timed and shape[0] in windows
            is_row = all(n == 1 for n in shape[:-1]) and (not shape or shape[-1] not in windows)
            if not (runs or (is_row and not found.timed) or found.values.size == 1):
                return None
            wholes.append(Whole(self.parameters.term(name), shape))
        name = self._formula(function, key, wholes)
        if name is None:
            found = follow(function, wholes)
            if not isinstance(found, Whole):
                return self._put_together(function, found if batched else found[None])
            term, shape = found.term, found.shape
        else:
            shape = self._shapes[(name, tuple(whole.shape for whole in wholes))]
            terms = [whole.term for whole in wholes]
            term = joined(Call(name), *terms, dim=shape[-1] if shape else 1)
        shape = shape if batched else (1, *shape)
        # what is no batch × samples × elements is looked at element by element
        if len(shape) != 3 or shape[0] != 1 or (term.window or 1) != shape[1]:
            return None
        return one_piece(Term(term.head, term.args, term.window, shape[2]))

    def _formula(self, function: ast.FunctionDef, key: Any, wholes: Sequence[Whole]) -> str | None:
        """The name of a function of the spec for arguments of these shapes; None if its formula is
        a single operation, too long, or needs separate elements. `key` identifies the function.
        Raises FunctionError for unsupported code, NeedsElementsError.
        """
        known = (key, tuple(whole.shape for whole in wholes))
        if known in self._formulas:
            return self._formulas[known]
        local = TakenNames()
        args = [local.free(name) for name in argument_names(function)]
        if len(args) != len(wholes):
            line = f"it takes {len(args)} arguments and gets {len(wholes)}"
            raise FunctionError(function.lineno, line)
        # followed once with names for its arguments: what comes out is a function of the spec
        symbols = [Whole(Term(Named(a)), w.shape) for a, w in zip(args, wholes, strict=True)]
        made = follow(function, symbols)
        name = None
        if isinstance(made, Whole) and 1 < _size(made.term) <= _LONGEST:
            formula = Formula(tuple(args), text_of_whole(made.term))
            # two sources may say the same: one function is enough
            same = (one for one, other in self.declared.items() if other == formula)
            name = next(same, None) or self.names.free(function.name)
            self.declared[name] = formula
            self._shapes[(name, known[1])] = made.shape
        self._formulas[known] = name
        return name

    def _elements(self, value: Value, front: tuple[int, ...]) -> Elements:
        if value.window * value.dim > arrays.MOST:
            raise FunctionError(1, "its arguments have too many elements")
        out = np.empty((value.window, value.dim), dtype=object)
        for k in range(value.window):
            sample = self.values.samples(value, k, k + 1)
            for i in range(value.dim):
                out[k, i] = self.values.element(sample, i).pieces[0]
        return out.reshape((*front, value.window, value.dim))

    def _put_together(self, function: ast.FunctionDef, found: Elements) -> Value:
        if found.size == 0:
            raise FunctionError(function.lineno, "it returns no elements")
        if found.ndim != 3 or found.shape[0] != 1:
            shape = " × ".join(map(str, found.shape)) or "a number"
            raise FunctionError(function.lineno, f"it returns {shape}, not 1 × samples × elements")
        samples = [self.values.stacked([one_piece(term) for term in row]) for row in found[0]]
        return self.values.after(*samples)

    def _refused(
        self, path: str, place: tuple[str | int, ...], code: str, fault: FunctionError
    ) -> SpecError:
        lines = code.splitlines()
        line = lines[fault.line - 1].strip() if 0 < fault.line <= len(lines) else ""
        span = self._line_span(place, fault.line)
        return SpecError([untranslated(path, line[:100], fault.reason, span)], [self.text.source])

    def _line_span(self, place: tuple[str | int, ...], line: int) -> Span:
        r"""The place in the JSON file of one line of a source text, in which `\n` marks a line end;
        the whole text if lines cannot be told apart. `place` is the path below `Functions`.
        """
        path = ("Functions", *place)
        start, end = self.text.places.get(path, (0, 0))
        raw = self.text.source.text[start:end]
        pieces = raw.split("\\n")
        # where backslashes are escaped, `\\n` may be two letters of the text: the whole text is the
        # place
        if not 0 < line <= len(pieces) or "\\\\" in raw:
            return self.text.place(*path)
        # two letters for each `\n` before it; the first line begins behind the quote
        begin = start + sum(len(piece) + 2 for piece in pieces[: line - 1]) + (line == 1)
        text = pieces[line - 1]
        indent = len(text) - len(text.lstrip())
        return self.text.source.span(begin + indent, begin + max(len(text), indent + 1))


def _size(term: Term) -> int:
    """The number of operations in the text of a term; a part that is used twice counts twice."""
    count: dict[int, int] = {}
    for node in after_operands(term, lambda one: False):
        count[id(node)] = 1 + sum(count[id(arg)] for arg in node.args)
    return count[id(term)]
