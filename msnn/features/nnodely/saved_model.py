"""Validates the JSON of an nnodely 1.x model, and reads its relations as a graph."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, TypeAlias, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat, ValidationError
from pydantic_core import ErrorDetails

from msnn.features.nnodely.errors import wrong_json
from msnn.features.nnodely.json_text import JsonText, path_text
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

_MOST_FAULTS = 8

Size: TypeAlias = Annotated[int, Field(ge=1, le=100_000)]
Number: TypeAlias = int | FiniteFloat
# bounds keep sums and products of windows far from what memory and integers hold
Samples: TypeAlias = Annotated[int, Field(ge=-1_000_000, le=1_000_000)]


class _Strict(BaseModel):
    # strict: JSON's `true` is no 1. Other keys are those of other versions and of training, ignored
    model_config = ConfigDict(strict=True, extra="ignore", frozen=True)


class Info(_Strict):
    """The section `Info` of a saved model: facts about the whole model, such as the sample time."""

    SampleTime: Annotated[Number, Field(gt=0)] = 1


class Input(_Strict):
    """A signal: its number of elements, the union of its windows in samples (`sw`) or seconds
    (`tw`), and the relation that feeds it (`closed_loop`: its next value, `connect`: its current
    value).
    """

    dim: Size
    sw: Annotated[list[Samples], Field(min_length=2, max_length=2)] | None = None
    tw: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    closed_loop: Annotated[str | None, Field(alias="closedLoop")] = None
    connect: str | None = None
    local: int = 0


class Array(_Strict):
    """A parameter or constant of a saved model: its sizes, its window in samples or seconds, its
    values and initial values.
    """

    dim: Size | list[Size]
    sw: Size | None = None
    tw: Annotated[Number, Field(gt=0)] | None = None
    values: Any = None
    init_values: Any = None


class Function(_Strict):
    """A function of a saved model: fuzzy sets, or the source text of a Python function."""

    code: str | None = None
    name: str | None = None
    params_and_consts: list[str] = []
    map_over_dim: bool | list[int | None] = False
    centers: list[Number] | None = None
    dim_out: dict[str, Size] | None = None
    functions: str | list[str] | None = None
    names: str | list[str] | None = None


class Minimizer(_Strict):
    """A training loss: the relations or outputs A and B, and the kind of loss, such as `mse`."""

    A: str
    B: str
    loss: str


def _relation(given: list[Any]) -> list[Any]:
    kind, operands = given[:2]
    # what follows depends on the kind, and is judged where that is known
    if not isinstance(kind, str) or names_in(operands) != operands:
        raise ValueError("a relation is [kind, [names of operands], …]")
    return given


def names_in(operands: Any) -> list[str]:
    """The texts in the list of a relation's operands, which are names; empty if it is no list."""
    if not isinstance(operands, list):
        return []
    return [one for one in cast("list[Any]", operands) if isinstance(one, str)]


class File(_Strict):
    """The JSON content of a saved model by its sections, validated."""

    Info: Info
    Inputs: dict[str, Input]
    Constants: dict[str, Array] = {}
    Parameters: dict[str, Array] = {}
    Functions: dict[str, Function] = {}
    Relations: dict[str, Annotated[list[Any], Field(min_length=2), AfterValidator(_relation)]]
    Outputs: dict[str, str]
    Minimizers: dict[str, Minimizer] = {}


def read_file(text: JsonText) -> File:
    """The model in a JSON text. Without outputs, those are the relations that losses compare.
    Raises SpecError with the first invalid values, and if there is no output.
    """
    try:
        file = File.model_validate(text.value)
    except ValidationError as fault:
        found = fault.errors(include_url=False, include_context=False)
        raise SpecError([_said(text, one) for one in found[:_MOST_FAULTS]], [text.source]) from None
    outputs = file.Outputs or _compared(file)
    if not outputs:
        reason = "there are none, and no loss compares what the model computes"
        diagnostic = wrong_json("Outputs", reason, text.place("Outputs"))
        raise SpecError([diagnostic], [text.source])
    return file.model_copy(update={"Outputs": outputs})


def _compared(file: File) -> dict[str, str]:
    """The relations that training losses compare, by their own names, without those that only read
    an input.
    """
    sides = [side for one in file.Minimizers.values() for side in (one.A, one.B)]
    return {side: side for side in sides if side in file.Relations and not _reads(file, side)}


def _reads(file: File, relation: str) -> bool:
    kind, operands = file.Relations[relation][:2]
    sources = names_in(operands)
    # a side that only reads an input is what the other one is compared with
    return kind in {"SamplePart", "TimePart"} and len(sources) == 1 and sources[0] in file.Inputs


def _said(text: JsonText, fault: ErrorDetails) -> Diagnostic:
    # a union names its branches among the steps, which the text does not have
    path: list[str | int] = []
    for step in fault["loc"]:
        if (*path, step) in text.places:
            path.append(step)
    missing = fault["loc"][-1] if fault["type"] == "missing" else None
    reason = f"`{missing}` is missing" if missing is not None else fault["msg"].lower()
    return wrong_json(path_text(tuple(path)), reason, text.place(*path))


@dataclass(frozen=True)
class Graph:
    """The relations of a saved model as a graph, with queries for recognising groups."""

    file: File

    @cached_property
    def uses(self) -> Mapping[str, int]:
        """How often each name is an operand, an output, fed back, connected, or compared
        by a loss.
        """
        found: Counter[str] = Counter(self.file.Outputs.values())
        for name in self.file.Relations:
            found.update(self.operands(name))
        for given in self.file.Inputs.values():
            found.update(one for one in (given.connect, given.closed_loop) if one is not None)
        for given in self.file.Minimizers.values():
            # a loss reads as well: what it compares may not vanish into a layer
            found.update((given.A, given.B))
        return found

    def operands(self, name: str) -> list[str]:
        """The operands of a relation; empty for a name that is no relation."""
        return names_in(self.file.Relations.get(name, ["", []])[1])

    def pair(self, name: str, kind: str) -> tuple[str, str] | None:
        """The two operands of the relation `name` if it has that kind, such as `Add`; None
        otherwise.
        """
        operands = self.operands(name)
        if name in self.file.Relations and self.file.Relations[name][0] == kind:
            return (operands[0], operands[1]) if len(operands) == 2 else None
        return None

    def is_constant(self, name: str, value: float) -> bool:
        """True if `name` is a scalar constant with this value."""
        if name not in self.file.Constants:
            return False
        # nnodely writes numbers with zero, one or two brackets
        return self.file.Constants[name].values in (value, [value], [[value]])

    def sample(self, name: str, age: int) -> str | None:
        """The input of which a relation is the sample `age` steps before the current one; None for
        other relations.
        """
        given = self.file.Relations.get(name)
        # [−1, 0] is the current sample, [−2, −1] the one before
        wanted = ["SamplePart", -1, [-1 - age, -age]]
        if given is None or len(given) != 4 or [given[0], *given[2:]] != wanted:
            return None
        operands = self.operands(name)
        return operands[0] if len(operands) == 1 and operands[0] in self.file.Inputs else None


def shared_arrays(file: File) -> frozenset[str]:
    """The names of parameters and constants that are used more than once: in different layers,
    formulas or functions. Equal layers count once.
    """
    arrays = {*file.Parameters, *file.Constants}
    layers: set[tuple[str, ...]] = set()
    uses: Counter[str] = Counter()
    for kind, operands, *rest in file.Relations.values():
        uses.update({one for one in names_in(operands) if one in arrays})
        if kind in {"Fir", "Linear"} and len(rest) >= 2:
            # a set: equal layers are one in the spec, and use their arrays once
            layers.add((kind, *map(str, rest)))
    for _, weight, bias, *_ in layers:
        uses.update({weight, bias} & arrays)
    for function in file.Functions.values():
        uses.update(set(function.params_and_consts))
    return frozenset(name for name, count in uses.items() if count > 1)


def shared_across(file: File) -> frozenset[str]:
    """The shared arrays that are matrices of `Linear`, which the spec has transposed."""
    layers = (rest for kind, _, *rest in file.Relations.values() if kind == "Linear")
    weights = {str(rest[0]) for rest in layers if rest}
    return shared_arrays(file) & weights
