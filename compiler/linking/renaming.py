"""Replaces the names in an entry of a sub-model by full names."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar, cast

from pydantic.fields import FieldInfo

from compiler.ir.scalars import OF_THE_LANGUAGE
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.language import INDICES, LENGTH
from spec_schema.expressions.tree import Call, Expression, Keyword, LanguageName, Member, Name
from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Choice, Gathering, Located, signals, some_signals
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.layer_kinds import EQUATION_TERMS, EquationLearner
from spec_schema.sections.values import Function, Initializer
from spec_schema.units.quantity import Quantity
from spec_schema.units.unit import Unit

T = TypeVar("T")


@dataclass(frozen=True)
class Renaming:
    """Replaces the names in one spec by full names.

    `names` maps all names that the spec and its sub-models declare to full names. `prefix` is that
    of the sub-model, such as `vehicle.`. An undeclared name gets it too, so that it is not mistaken
    for a name of another spec.
    """

    prefix: str
    names: Mapping[str, str]

    def name(self, name: str) -> str:
        """The full name of a name in the spec. Names of the language, such as `sin`, stay."""
        found = self.names.get(name)
        if found is not None:
            return found
        return name if name in OF_THE_LANGUAGE else self.prefix + name

    def entry(self, entry: T) -> T:
        """A copy of an entry, expression or reference of the spec, with full names."""
        return cast("T", self._renamed(entry, frozenset()))

    def _renamed(self, value: Any, arguments: frozenset[str]) -> Any:
        """A copy of any part of an entry with full names. `arguments` are names that stay: those of
        function arguments and of indices.
        """
        match value:
            case None | str() | int() | float() | Span() | Unit() | Quantity():
                return cast("Any", value)  # most of what there is
            case Name():
                return value if value.name in arguments else self._named(value)
            case Initializer(file=Located()):
                return value  # the path of a file is no name
            case Initializer():
                # an entry of the spec hides the index of that name
                own = frozenset(name for name in (*INDICES, LENGTH) if name not in self.names)
                return self._entry(value, arguments | own)
            case Member():
                return self._member(value)
            case Call():
                return self._call(value, arguments)
            case EquationLearner():
                # an entry of the spec hides the term of that name
                own = frozenset(name for name in EQUATION_TERMS if name not in self.names)
                return self._entry(value, arguments | own)
            case Keyword(name="method"):
                return value  # of an integral or derivative: a word, no name
            case Keyword():
                return replace(value, value=self._renamed(value.value, arguments))
            case Choice():
                return cast("Any", value)
            case Located(value=str() as text):
                named = text if text in arguments else self.name(text)
                return replace(cast("Located[str]", value), value=named)
            case Function():
                own = frozenset(argument.value for argument in value.args)
                return value.model_copy(update={"expr": self._renamed(value.expr, own)})
            case Entry():
                return self._entry(value, arguments)
            case tuple():
                parts = cast("tuple[Any, ...]", value)
                return tuple(self._renamed(part, arguments) for part in parts)
            case Located():
                return cast("Any", value)
            case _ if dataclasses.is_dataclass(value) and not isinstance(value, type):
                return self._dataclass(value, arguments)
            case _:
                return value

    def _named(self, name: Name) -> Name:
        full = self.name(name.name)
        # the whole model may have an entry called like a builtin that this sub-model calls
        is_language = bool(self.prefix) and full in OF_THE_LANGUAGE
        return LanguageName(full, name.span) if is_language else Name(full, name.span)

    def _member(self, member: Member) -> Expression:
        """The expression `base.member` with full names: `tire.mu` becomes the name of an entry of
        the sub-model `tire`; `x.meas` remains a member of the entry `x`.
        """
        full = f"{member.base}.{member.name}"
        if full in self.names:
            return Name(self.names[full], member.span)
        return Member(self.name(member.base), member.name, member.span)

    def _call(self, call: Call, arguments: frozenset[str]) -> Call:
        renamed = [self._renamed(argument, arguments) for argument in call.arguments]
        if isinstance(call.function, Name) and call.function.name == "part" and len(renamed) > 1:
            # `part(q, joint2)`: a label of a dimension is no name of the spec
            renamed[1:] = call.arguments[1:]
        return Call(
            self._renamed(call.function, arguments),
            tuple(renamed),
            self._renamed(call.keywords, arguments),
            call.span,
        )

    def _entry(self, entry: Entry, arguments: frozenset[str]) -> Entry:
        changed: dict[str, Any] = {}
        for name, field in type(entry).model_fields.items():
            before = getattr(entry, name)
            if isinstance(before, Mapping):
                after = self._mapping(cast("Mapping[str, Any]", before), field, arguments)
            else:
                after = self._renamed(before, arguments)
            if after is not before:
                changed[name] = after
        return entry.model_copy(update=changed) if changed else entry

    def _mapping(
        self, before: Mapping[str, Any], field: FieldInfo, arguments: frozenset[str]
    ) -> Mapping[str, Any]:
        """The mapping `before`, the value of an entry's field, with full names in its values. Keys
        that are names of signals get full names too; others, which the entry itself declares, stay.
        """
        are_signals = any(
            isinstance(note, Gathering) and note.schema in (signals, some_signals)
            for note in field.metadata
        )
        return {
            self.name(key) if are_signals else key: self._renamed(value, arguments)
            for key, value in before.items()
        }

    def _dataclass(self, value: Any, arguments: frozenset[str]) -> Any:
        changed: dict[str, Any] = {}
        for field in dataclasses.fields(value):
            before = getattr(value, field.name)
            after = self._renamed(before, arguments)
            if after is not before:
                changed[field.name] = after
        return replace(value, **changed) if changed else value
