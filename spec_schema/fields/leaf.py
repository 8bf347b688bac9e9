"""Values of a spec with their place, and validators with the JSON Schema of their values."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, Generic, TypeAlias, TypeVar

from pydantic import BeforeValidator, GetCoreSchemaHandler, ValidationInfo
from pydantic_core.core_schema import CoreSchema, with_info_plain_validator_function

from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.names import LONGEST_NAME, RESERVED_PATTERN

Value = TypeVar("Value")


@dataclass(frozen=True)
class Located(Generic[Value]):
    """A value with its place, and the place of its key if it has one."""

    value: Value
    # a value is the same wherever it is written: equal specs make equal programs
    span: Span = field(compare=False)
    key: Span | None = field(default=None, compare=False)


@dataclass(frozen=True)
class Choice(Located[Value]):
    """A word of a fixed set such as `saturate`; it is never taken for a name that the spec
    declares.
    """


@dataclass(frozen=True)
class KeyAndValueSpan:
    """The places of an entry: its key (or name) and its whole value."""

    key: Span
    value: Span


class Spelled(ABC):
    """A value that defines by itself how it is written in a spec."""

    @property
    @abstractmethod
    def spelling(self) -> object:
        """The plain value, such as a tuple or a text, that a spec would contain and that reads as
        an equal one.
        """


JsonSchema: TypeAlias = Mapping[str, Any]

# Ranges are written out, because `\w` is ASCII in the JavaScript of editors; the signs of micro and
# of ohm are there beside the Greek letters that normalisation makes of them.
_NAME = f"[A-Za-zµΩͰ-Ͽ][A-Za-z0-9_µΩͰ-Ͽ]{{0,{LONGEST_NAME - 1}}}"
NEW_NAME = rf"^(?!({RESERVED_PATTERN})$){_NAME}$"
REFERENCE = rf"^{_NAME}(\.{_NAME})*$"
MEMBER = rf"^{_NAME}(\.{_NAME})+$"


@dataclass(frozen=True)
class LeafField:
    """A pydantic annotation that reads one value from a node; `schema` is the JSON Schema of its
    text.
    """

    read: Callable[[Any, ValidationInfo], Any]
    schema: JsonSchema = field(default_factory=dict[str, Any], compare=False)

    def __get_pydantic_core_schema__(
        self, source_type: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """The reader alone.

        A `PlainValidator` also finds out how each type would be written, which nobody asks for:
        for the parts of expressions and units that took half of the time of building the schema.
        """
        del source_type, handler
        return with_info_plain_validator_function(self.read)


@dataclass(frozen=True)
class Gathering(BeforeValidator):
    """Prepares a list or mapping; `schema` describes it, given the schema of an item."""

    schema: Callable[[JsonSchema], JsonSchema] = field(default=dict, compare=False)


def one_or_many(item: JsonSchema) -> JsonSchema:
    """The schema of a list whose single item may be written without brackets.

    Words to choose from become a pattern, because `enum` would also apply to the list.
    """
    types = item.get("type", [])
    alone = [types] if isinstance(types, str) else list(types)
    said = {key: value for key, value in item.items() if key != "enum"}
    if "enum" in item:
        # `enum` on a list compares the whole list
        said["pattern"] = f"^({'|'.join(item['enum'])})$"
    return {**said, "type": [*alone, "array"], "items": item}


def list_of(item: JsonSchema) -> JsonSchema:
    """The schema of a list with such items."""
    return {"type": "array", "items": item}


def declarations(item: JsonSchema) -> JsonSchema:
    """The schema of a mapping whose keys are new names, with such values."""
    # `x-` keys of other tools are admitted by the schema around, not here
    names = {"pattern": NEW_NAME}
    return {"type": ["object", "null"], "propertyNames": names, "additionalProperties": item}


def signals(item: JsonSchema) -> JsonSchema:
    """The schema of a mapping whose keys are names of signals, with such values."""
    names = {"pattern": REFERENCE}
    return {"type": ["object", "null"], "propertyNames": names, "additionalProperties": item}


def some_signals(item: JsonSchema) -> JsonSchema:
    """The schema of a mapping like `signals`, with at least one key."""
    return {**signals(item), "type": "object", "minProperties": 1}


def members(item: JsonSchema) -> JsonSchema:
    """The schema of a mapping whose keys are members of sub-models, with such values."""
    names = {"pattern": MEMBER}
    return {"type": ["object", "null"], "propertyNames": names, "additionalProperties": item}


def any_keys(item: JsonSchema) -> JsonSchema:
    """The schema of a mapping whose keys are names or patterns of names, with such values."""
    return {"type": ["object", "null"], "additionalProperties": item}
