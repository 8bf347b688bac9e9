"""Converts answers to types of the Language Server Protocol."""

from __future__ import annotations

from typing import assert_never

from lsprotocol import types
from pygls.uris import from_fs_path

from compiler.lowering.context import Kind
from msnn.features.language_server.completion import Completion, Item, ItemKind
from msnn.features.language_server.cursor import Heading, OutlineSection
from msnn.features.language_server.definition import Definition
from msnn.features.language_server.positions import Position, TextRange, position_of
from msnn.features.language_server.problems import Problem, Repair
from msnn.features.language_server.view import View
from spec_schema.diagnostics.diagnostic import Severity

_SYMBOLS = {
    Kind.SUBMODEL: types.SymbolKind.Module,
    Kind.DIMENSION: types.SymbolKind.Enum,
    Kind.CONSTANT: types.SymbolKind.Constant,
    Kind.LAYER: types.SymbolKind.Function,
    Kind.FUNCTION: types.SymbolKind.Function,
}


def range_to(range: TextRange) -> types.Range:
    """A range in the type of the protocol."""
    return types.Range(_position(range.start), _position(range.end))


def diagnostic_of(problem: Problem) -> types.Diagnostic:
    """A problem in the type of the protocol, with its code, and further places as related
    information.
    """
    related = [
        types.DiagnosticRelatedInformation(
            types.Location(_address(place.path), range_to(place.range)), place.label
        )
        for place in problem.related
    ]
    return types.Diagnostic(
        range=range_to(problem.range),
        message=problem.text,
        severity=_severity(problem.diagnostic.severity),
        code=problem.diagnostic.code,
        source="msnn",
        related_information=related or None,
    )


def action_of(repair: Repair, address: str) -> types.CodeAction:
    """A quick fix in the type of the protocol, as an edit of the text with the URI `address`."""
    edit = types.TextEdit(range_to(repair.problem.range), repair.text)
    return types.CodeAction(
        title=repair.title,
        kind=types.CodeActionKind.QuickFix,
        diagnostics=[diagnostic_of(repair.problem)],
        # editors have one key for the preferred repair
        is_preferred=True,
        edit=types.WorkspaceEdit(changes={address: [edit]}),
    )


def location_of(found: Definition) -> types.Location:
    """The place of a definition in the type of the protocol."""
    return types.Location(_address(found.path), range_to(found.range))


def completion_list(found: Completion) -> types.CompletionList:
    """The proposals in the type of the protocol, in their order."""
    range = range_to(found.range)
    items = [_item(item, number, range) for number, item in enumerate(found.items)]
    return types.CompletionList(is_incomplete=not found.is_whole, items=items)


def symbols_of(view: View) -> list[types.DocumentSymbol]:
    """The sections of a text with the keys below them, for the outline of an editor."""
    return [_section(section, view) for section in view.outline]


def _section(section: OutlineSection, view: View) -> types.DocumentSymbol:
    kind = types.SymbolKind.Key
    if section.kind is not None:
        kind = _SYMBOLS.get(section.kind, types.SymbolKind.Variable)
    entries = [_symbol(heading, kind, view) for heading in section.entries]
    whole = _symbol(section.heading, types.SymbolKind.Namespace, view)
    whole.children = entries or None
    return whole


def _symbol(heading: Heading, kind: types.SymbolKind, view: View) -> types.DocumentSymbol:
    start = _position(position_of(heading.line, heading.column, view.source))
    end = _position(position_of(heading.line, heading.end_column, view.source))
    # the end is exclusive: the beginning of the line after the last
    last = types.Position(heading.last_line + 1, 0) if heading.last_line > heading.line else end
    return types.DocumentSymbol(
        name=heading.name,
        kind=kind,
        range=types.Range(start, last),
        selection_range=types.Range(start, end),
    )


def _item(item: Item, number: int, range: types.Range) -> types.CompletionItem:
    doc = types.MarkupContent(types.MarkupKind.Markdown, item.doc) if item.doc else None
    return types.CompletionItem(
        label=item.label,
        kind=_item_kind(item.kind),
        detail=item.detail or None,
        documentation=doc,
        # editors sort by text: leading zeros keep 10 behind 9
        sort_text=f"{number:04}",
        filter_text=item.label,
        text_edit=types.TextEdit(range, item.insert),
    )


def _item_kind(kind: ItemKind) -> types.CompletionItemKind:
    match kind:
        case "key":
            return types.CompletionItemKind.Property
        case "name":
            return types.CompletionItemKind.Variable
        case "function":
            return types.CompletionItemKind.Function
        case "unit":
            return types.CompletionItemKind.Unit
        case "word":
            return types.CompletionItemKind.EnumMember
        case _:
            assert_never(kind)


def _severity(severity: Severity) -> types.DiagnosticSeverity:
    match severity:
        case "error":
            return types.DiagnosticSeverity.Error
        case "warning":
            return types.DiagnosticSeverity.Warning
        case "note":
            return types.DiagnosticSeverity.Information
        case _:
            assert_never(severity)


def _position(position: Position) -> types.Position:
    return types.Position(position.line, position.character)


def _address(path: str) -> str:
    return from_fs_path(path) or path
