"""Evaluates the relations of a saved model, each to a value."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from msnn.features.nnodely.errors import (
    circle,
    left_out,
    unfit_shapes,
    unknown_name,
    unknown_relation,
)
from msnn.features.nnodely.followed_python.torch_names import SAME, negative
from msnn.features.nnodely.functions import Functions, NotRecognisedError
from msnn.features.nnodely.json_text import JsonText, path_text
from msnn.features.nnodely.layers import Layers, Weighted, fuzzified, interpolated
from msnn.features.nnodely.parameters import Parameters
from msnn.features.nnodely.recognition import Recognised
from msnn.features.nnodely.saved_model import File, names_in
from msnn.features.nnodely.signals import Signals
from msnn.features.nnodely.terms import (
    Call,
    CutError,
    Held,
    Term,
    call,
    minus,
    plus,
    power,
    quotient,
    same,
    times,
)
from msnn.features.nnodely.values import ShapeError, Value, ValueOperations, filled
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError


@dataclass(slots=True, kw_only=True)
class Relations:
    """Translates the relations of a saved model to values, each once."""

    file: File
    text: JsonText
    values: ValueOperations
    parameters: Parameters
    layers: Layers
    functions: Functions
    findings: Findings
    signals: Signals | None = None
    held: dict[str, Term | None] = field(default_factory=dict[str, "Term | None"])
    """Relations used for gradients, as separate equations."""
    recognised: dict[str, Recognised] = field(default_factory=dict[str, Recognised])
    """Recognised groups of relations."""
    _known: dict[str, Value] = field(default_factory=dict[str, Value])

    def of(self, name: str) -> Value:
        """The value of a relation; translates its operands first. Raises SpecError for unsupported
        or invalid relations, and for a circle of relations within one step.
        """
        # a stack of our own: chains of relations are longer than Python lets functions nest
        stack: list[tuple[str, bool]] = [(name, False)]
        open_names: dict[str, None] = {}
        while stack:
            current, ready = stack.pop()
            if current in self._known:
                continue
            if ready:
                del open_names[current]
                try:
                    self._known[current] = self._followed(current)
                except NotRecognisedError:
                    # what looked like one thing of many relations is none: they are followed one by
                    # one
                    del self.recognised[current]
                    stack.append((current, False))
                continue
            # a circle without an input between: no sample would come first
            if current in open_names:
                members = [*open_names]
                ring = [*members[members.index(current) :], current]
                raise self.refused(circle(ring[:6], self.text.place("Relations", current)))
            open_names[current] = None
            stack.append((current, True))
            stack.extend((one, False) for one in self._needed(current) if one not in self._known)
        return self._known[name]

    @property
    def known(self) -> Mapping[str, Value]:
        """The relations that have been translated, with their values."""
        return self._known

    def refused(self, diagnostic: Diagnostic) -> SpecError:
        """The error with this diagnostic and the text of the file, to be raised."""
        return SpecError([diagnostic], [self.text.source])

    def _needed(self, name: str) -> list[str]:
        if name in self.recognised:
            return list(self.recognised[name].needs)
        needed: list[str] = []
        for position, operand in enumerate(names_in(self.file.Relations[name][1])):
            if operand in self.file.Relations:
                needed.append(operand)
            elif operand in self.file.Inputs:
                source = self.file.Inputs[operand].connect
                if source is not None and source not in self.file.Relations:
                    path = f"Inputs.{operand}.connect"
                    place = self.text.place("Inputs", operand, "connect")
                    raise self.refused(unknown_name(path, source, "relation", place))
                # an input that is closed needs nothing: its past is a state
                needed.extend([source] if source is not None else [])
            elif not self.parameters.has(operand):
                path = path_text(("Relations", name, 1, position))
                place = self.text.place("Relations", name, 1, position)
                raise self.refused(unknown_name(path, operand, "relation or parameter", place))
        return needed

    def _followed(self, name: str) -> Value:
        place = self.text.place("Relations", name)
        path = f"Relations.{name}"
        try:
            if name in self.recognised:
                value = self.recognised[name].make(self)
            else:
                value = self._made(name)
        except ShapeError as fault:
            raise self.refused(unfit_shapes(path, str(fault), place)) from None
        except CutError:
            reason = "a part of a window that is not known sample by sample"
            raise self.refused(unfit_shapes(path, reason, place)) from None
        except UnknownKindError as fault:
            raise self.refused(unknown_relation(path, str(fault), fault.repair, place)) from None
        if name in self.held:
            whole = self.values.whole(value)
            self.held[name] = whole
            head = Held(self.values_name(name))
            # from here on by its name, or `grad` would find another formula to differentiate by
            value = Value(value.window, value.dim, (Term(head, (), whole.window, whole.dim),))
        return value

    def values_name(self, name: str) -> str:
        """The name of the equation in the spec that a relation becomes."""
        return self.parameters.names.of("relation", name)

    def operand(self, name: str) -> Value:
        """The value of an operand by name: a translated relation or a parameter. Raises ShapeError
        for a matrix, and for an input, which must be read by a window.
        """
        if name in self._known:
            return self._known[name]
        if self.parameters.has(name):
            value = self.parameters.operand(name)
            if value is not None:
                return value
            raise ShapeError(f"`{name}` is a matrix")
        raise ShapeError(f"the input `{name}` is read without a window")

    def _made(self, name: str) -> Value:
        kind, operands, *rest = self.file.Relations[name]
        if kind in {"SamplePart", "TimePart"}:
            return self._windowed(kind, operands, rest)
        if kind == "ParamFun":
            # a matrix is no value along time; functions take it as an array
            streams = [o if self.parameters.is_matrix(o) else self.operand(o) for o in operands]
            return self.functions.called(one_name(rest), streams, name)
        values = [self.operand(operand) for operand in operands]
        if kind in OF_TWO:
            return self.values.elementwise(OF_TWO[kind], *counted(values, 2))
        if kind in OF_ONE:
            return self.values.elementwise(OF_ONE[kind], *counted(values, 1))
        if kind in {"Concatenate", "TimeConcatenate"}:
            left, right = counted(values, 2)
            beside = kind == "Concatenate"
            return self.values.beside(left, right) if beside else self.values.after(left, right)
        if kind == "Differentiate":
            of, by = counted(values, 2)
            return self._gradient(of, by)
        [value] = counted(values, 1)
        return self._of_one(name, kind, value, rest)

    def _of_one(self, name: str, kind: str, value: Value, rest: list[Any]) -> Value:
        match kind, rest:
            case "Sum", []:
                over = f", over={self.values.dims.of(value.dim)}"
                # a scalar has no dimension to sum over
                if value.dim == 1:
                    return value
                return self.values.along(lambda x: call("sum", x, rest=over, dim=1), value, 1)
            case "Softmax", []:
                if value.dim == 1:
                    return filled(1.0, value)
                over = f", over={self.values.dims.of(value.dim)}"
                return self.values.along(lambda x: call("softmax", x, rest=over), value, value.dim)
            case "Part", [_, [int() as first, int() as end]]:
                if not 0 <= first < end <= value.dim:
                    raise ShapeError(f"elements {first} … {end - 1} of {value.dim} do not exist")
                parts = [self.values.element(value, i) for i in range(first, end)]
                return value if len(parts) == value.dim else self.values.stacked(parts)
            case "Select", [_, int() as index]:
                return self.values.element(value, index)
            case "SampleSelect", [_, int() as index]:
                return self.values.samples(value, index, index + 1)
            case (("Fir" | "Linear"), [str() as weight, (str() | None) as bias, *share]):
                return self._weighted(
                    name, kind, value, Weighted(kind, weight, bias, dropout_share(share))
                )
            case "Fuzzify", [str() as function] if function in self.file.Functions:
                return fuzzified(self.functions, self.layers, function, value, self.findings)
            case "Interpolation", [x, y, str() as mode]:
                place = self.text.place("Relations", name)
                return interpolated(self.layers, name, (x, y, mode), value, (self.findings, place))
            case _:
                raise unknown_form(kind)

    def _weighted(self, name: str, kind: str, value: Value, layer: Weighted) -> Value:
        for array in (layer.weight, layer.bias):
            if array is not None and not self.parameters.has(array):
                place = self.text.place("Relations", name)
                path = f"Relations.{name}"
                raise self.refused(unknown_name(path, array, "parameter", place))
        if layer.dropout:
            place = self.text.place("Relations", name)
            self.findings.report(left_out(layer.dropout, name, place))
        return self.layers.fir(layer, value) if kind == "Fir" else self.layers.linear(layer, value)

    def _windowed(self, kind: str, operands: list[str], rest: list[Any]) -> Value:
        match rest:
            case [_, [int() | float() as first, int() | float() as end]]:
                offset = None
            case [_, [int() | float() as first, int() | float() as end], int() | float() as offset]:
                pass
            case _:
                raise unknown_form(kind)
        assert self.signals is not None
        [source] = operands if len(operands) == 1 else [""]
        bounds = [first, end, *([] if offset is None else [offset])]
        if kind == "TimePart":
            # seconds
            bounds = [self.signals.samples(source, bound) for bound in bounds]
        if not all(isinstance(bound, int) for bound in bounds):
            raise ShapeError("the bounds of samples are whole numbers")
        low, high, *start = (int(bound) for bound in bounds)
        if source in self.file.Inputs:
            value = self.signals.read(source, low, high)
            taken = [self.signals.read(source, at, at + 1) for at in start]
        else:
            whole = self.operand(source)
            value = self.values.samples(whole, low, high)
            taken = [self.values.samples(whole, at, at + 1) for at in start]
        # `offset`: the window relative to one of its own samples
        for sample in taken:
            value = self.values.elementwise(OF_TWO["Sub"], value, sample)
        return value

    def _gradient(self, of: Value, by: Value) -> Value:
        whole = self.values.whole(by)
        head = Call("grad", steady=False)
        return Value(
            by.window, by.dim, (Term(head, (self.values.whole(of), whole), whole.window, by.dim),)
        )


OF_TWO: Mapping[str, Callable[[Term, Term], Term]] = {
    "Add": plus,
    "Sub": minus,
    "Mul": times,
    "Div": quotient,
    "Pow": power,
}
"""Functions of two values, element by element."""
OF_ONE: Mapping[str, Callable[[Term], Term]] = {
    "Neg": negative,
    "Sign": SAME["sign"],
    "Sin": SAME["sin"],
    "Cos": SAME["cos"],
    "Tan": SAME["tan"],
    "Tanh": SAME["tanh"],
    "Cosh": SAME["cosh"],
    "Sech": lambda x: call("sech", x),
    "Relu": SAME["relu"],
    "ELU": SAME["elu"],
    "Sigmoid": SAME["sigmoid"],
    "Identity": same,
}
"""Functions of one value, element by element."""


class UnknownKindError(Exception):
    """A relation of a kind or form that is not supported: `what` is the reason, `repair` the advice
    to the user.
    """

    def __init__(self, what: str, repair: str) -> None:
        super().__init__(what)
        self.repair = repair


def unknown_form(kind: str) -> UnknownKindError:
    """The error for a relation of an unsupported kind or with unexpected arguments, to
    be raised.
    """
    repair = "save it anew by `saveModel` of nnodely 1.x, or write its formula in a spec"
    if kind == "NeuralODE":
        repair = "write `states: {x: {der: …}}` with `integrator:` in a spec"
    return UnknownKindError(f"a relation `{kind}` of this form is not known", repair)


def counted(values: list[Value], wanted: int) -> list[Value]:
    """The operands `values` unchanged; raises ShapeError if they are not `wanted` in number."""
    if len(values) != wanted:
        raise ShapeError(f"{len(values)} operands, where {wanted} are needed")
    return values


def one_name(rest: list[Any]) -> str:
    """The only element of `rest`, the arguments of a relation after its operands. Raises
    UnknownKindError if it is not a single text.
    """
    if len(rest) == 1 and isinstance(rest[0], str):
        return rest[0]
    what, repair = "a `ParamFun` of this form is not known", "name one function after its operands"
    raise UnknownKindError(what, repair)


def dropout_share(rest: list[Any]) -> float:
    """The dropout fraction in `rest`, the arguments of a layer after its arrays; 0 if there is
    none. Raises UnknownKindError outside 0 ≤ share < 1.
    """
    match rest:
        case []:
            return 0.0
        case [int() | float() as share] if not isinstance(share, bool) and 0 <= share < 1:
            return float(share)
        case _:
            raise UnknownKindError("a dropout that is no share", "take 0 … 1, without 1")
