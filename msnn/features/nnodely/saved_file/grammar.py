"""Validates the JSON of an nnodely 1.x model against its grammar."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat, ValidationError
from pydantic_core import ErrorDetails

from msnn.features.nnodely.errors import wrong_json
from msnn.features.nnodely.saved_file.json_text import JsonText, path_text
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
    """The facts of the whole model."""

    SampleTime: Annotated[Number, Field(gt=0)] = 1


class Input(_Strict):
    """A signal: its size, the union of its windows, and its feedback."""

    dim: Size
    sw: Annotated[list[Samples], Field(min_length=2, max_length=2)] | None = None
    tw: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    closed_loop: Annotated[str | None, Field(alias="closedLoop")] = None
    connect: str | None = None
    local: int = 0


class Array(_Strict):
    """A parameter or constant."""

    dim: Size | list[Size]
    sw: Size | None = None
    tw: Annotated[Number, Field(gt=0)] | None = None
    values: Any = None
    init_values: Any = None


class Function(_Strict):
    """Fuzzy sets, or the source text of a function."""

    code: str | None = None
    name: str | None = None
    params_and_consts: list[str] = []
    map_over_dim: bool | list[int | None] = False
    centers: list[Number] | None = None
    dim_out: dict[str, Size] | None = None
    functions: str | list[str] | None = None
    names: str | list[str] | None = None


class Minimizer(_Strict):
    """A loss between two relations or outputs."""

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
    """The names in the operands of a relation; empty for invalid ones."""
    if not isinstance(operands, list):
        return []
    return [one for one in cast("list[Any]", operands) if isinstance(one, str)]


class File(_Strict):
    """A saved model."""

    Info: Info
    Inputs: dict[str, Input]
    Constants: dict[str, Array] = {}
    Parameters: dict[str, Array] = {}
    Functions: dict[str, Function] = {}
    Relations: dict[str, Annotated[list[Any], Field(min_length=2), AfterValidator(_relation)]]
    Outputs: dict[str, str]
    Minimizers: dict[str, Minimizer] = {}


def read_file(text: JsonText) -> File:
    """The model in a JSON text. Raises SpecError with all invalid values."""
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
    """The relations compared by training losses, without windows of inputs."""
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
