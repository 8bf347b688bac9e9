"""Kinds of mappings whose files are imported when a spec has one of them.

To make a model of a class takes pydantic as long as to read a small section, and most specs have
few of the kinds that there are. Where a field's type is imported for type checkers alone,
`late_entries` gives what stands for it as the program runs.
"""

from __future__ import annotations

from importlib import import_module
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, ValidationInfo
from pydantic_core.core_schema import CoreSchema, with_info_plain_validator_function

from spec_schema.fields.entry import Entry
from spec_schema.late_dataclass import dataclass
from spec_schema.yaml_tree.nodes import Node


def late_entries(module: str, *names: str) -> list[Any]:
    """For each class of the module a type that says which it is, and reads as it does."""
    return [Annotated[Any, LateEntry(module, name)] for name in names]


@dataclass(frozen=True)
class LateObject:
    """The object of this name, in a module that may not be imported yet."""

    module: str
    name: str

    @property
    def value(self) -> Any:
        """The object itself."""
        return getattr(import_module(self.module), self.name)


@dataclass(frozen=True)
class LateEntry(LateObject):
    """The class of an entry, in a module that may not be imported yet."""

    @property
    def kind(self) -> type[Entry]:
        """The class itself."""
        return self.value

    def __get_pydantic_core_schema__(
        self, source_type: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """A reader that asks the class, as `Entry` has it below a field."""
        del source_type, handler
        return with_info_plain_validator_function(self._read)

    def _read(self, node: Node, info: ValidationInfo) -> Entry:
        return self.kind.model_validate(node, context=info.context)
