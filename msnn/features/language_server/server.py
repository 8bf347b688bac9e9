"""Implements the Language Server Protocol over standard streams, with pygls."""

from __future__ import annotations

import asyncio
import gc
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from lsprotocol import types
from pygls.lsp.server import LanguageServer
from pygls.uris import to_fs_path

from msnn.features.language_server.checks import Checks, OpenText
from msnn.features.language_server.completion import complete
from msnn.features.language_server.definition import definition
from msnn.features.language_server.hover import hover
from msnn.features.language_server.positions import Position, TextRange
from msnn.features.language_server.problems import repairs_of
from msnn.features.language_server.protocol import (
    action_of,
    completion_list,
    diagnostic_of,
    location_of,
    range_to,
    symbols_of,
)
from spec_schema.plugins import look_up
from spec_schema.version import __version__

Answer = TypeVar("Answer")


class SpecServer(LanguageServer):
    """A language server for specs; for every change the editor sends the complete text."""

    def __init__(self) -> None:
        # whole texts: a spec is small, and edits in UTF-16 units applied in order are a source of
        # faults
        full = types.TextDocumentSyncKind.Full
        super().__init__(  # pyright: ignore[reportUnknownMemberType]
            "msnn", __version__, text_document_sync_kind=full
        )
        self.checks = Checks(self._publish, self._complain)
        self.task: asyncio.Task[None] | None = None
        self.is_shut_down = False

    def _publish(self, address: str, opened: OpenText) -> None:
        found = [diagnostic_of(problem) for problem in opened.problems]
        params = types.PublishDiagnosticsParams(address, found, opened.version)
        self.text_document_publish_diagnostics(params)

    def _complain(self, message: str) -> None:
        self.window_show_message(types.ShowMessageParams(types.MessageType.Error, message))

    def at(
        self,
        params: types.HoverParams | types.CompletionParams | types.DefinitionParams,
        ask: Callable[[OpenText, Position], Answer | None],
    ) -> Answer | None:
        """The result of `ask` for the open text and the position in `params`; None if the text is
        not open, or if `ask` returns None.
        """
        opened = self.checks.texts.get(params.text_document.uri)
        if opened is None:
            return None
        return ask(opened, Position(params.position.line, params.position.character))


def serve() -> None:
    """Serves an editor over standard input and output until it ends or disconnects."""
    # a copy of the descriptor for the protocol; descriptor 1 then leads to stderr, for C libraries
    # too
    stdout = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what prints must not break the protocol
    look_up()  # completion knows the keys of plug-ins from the start
    server = spec_server()
    gc.freeze()  # the libraries never go: looking through them took 0.1 s of some answers
    try:
        server.start_io(sys.stdin.buffer, stdout)
    finally:
        server.checks.end()


def _path(address: str) -> str:
    """The path of the file with this URI; the URI itself for a text without a file."""
    return str(Path(to_fs_path(address) or address))


def spec_server() -> SpecServer:
    """A new server with handlers for all requests that msnn answers."""
    server = SpecServer()
    _follow_texts(server)
    _answer_places(server)
    _answer_texts(server)
    return server


def _follow_texts(server: SpecServer) -> None:
    @server.feature(types.INITIALIZED)
    async def initialized(params: types.InitializedParams) -> None:
        del params
        # kept: the loop holds tasks weakly only
        server.task = asyncio.create_task(server.checks.run())

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    def opened(params: types.DidOpenTextDocumentParams) -> None:
        document = params.text_document
        server.checks.put(document.uri, _path(document.uri), document.text, document.version)

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    def changed(params: types.DidChangeTextDocumentParams) -> None:
        document = params.text_document
        # each is a whole text, of which the last holds
        for change in params.content_changes[-1:]:
            server.checks.put(document.uri, _path(document.uri), change.text, document.version)

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(params: types.DidCloseTextDocumentParams) -> None:
        server.checks.close(params.text_document.uri)
        # diagnostics stay in an editor until they are replaced
        empty = types.PublishDiagnosticsParams(params.text_document.uri, [])
        server.text_document_publish_diagnostics(empty)

    @server.feature(types.TEXT_DOCUMENT_DID_SAVE)
    def saved(params: types.DidSaveTextDocumentParams) -> None:
        del params
        # another spec may use the file that was saved
        server.checks.look_again()

    @server.feature(types.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def watched(params: types.DidChangeWatchedFilesParams) -> None:
        del params
        server.checks.look_again()

    @server.feature(types.SHUTDOWN)
    def shut_down(params: Any) -> None:
        del params
        server.is_shut_down = True

    @server.feature(types.EXIT)
    def ended(*params: Any) -> None:
        del params
        server.checks.end()
        # the thread that reads the editor's messages waits for one that never comes
        # the protocol's codes: 0 after `shutdown`, 1 without
        os._exit(0 if server.is_shut_down else 1)

    # registered by their decorators; nobody calls them by name
    del initialized, opened, changed, closed, saved, watched, shut_down, ended


def _answer_places(server: SpecServer) -> None:
    @server.feature(types.TEXT_DOCUMENT_HOVER)
    def hovered(params: types.HoverParams) -> types.Hover | None:
        found = server.at(params, lambda opened, place: hover(opened.view, place))
        if found is None:
            return None
        text = types.MarkupContent(types.MarkupKind.Markdown, found.text)
        return types.Hover(text, range_to(found.range))

    options = types.CompletionOptions(trigger_characters=[".", " ", "(", "*", "/", "+", "-"])

    @server.feature(types.TEXT_DOCUMENT_COMPLETION, options)
    def completed(params: types.CompletionParams) -> types.CompletionList | None:
        found = server.at(params, lambda opened, place: complete(opened.view, place))
        return None if found is None else completion_list(found)

    @server.feature(types.TEXT_DOCUMENT_DEFINITION)
    def defined(params: types.DefinitionParams) -> types.Location | None:
        found = server.at(params, lambda opened, place: definition(opened.view, place))
        return None if found is None else location_of(found)

    del hovered, completed, defined


def _answer_texts(server: SpecServer) -> None:
    kinds = types.CodeActionOptions(code_action_kinds=[types.CodeActionKind.QuickFix])

    @server.feature(types.TEXT_DOCUMENT_CODE_ACTION, kinds)
    def repaired(params: types.CodeActionParams) -> list[types.CodeAction]:
        address = params.text_document.uri
        opened = server.checks.texts.get(address)
        only = params.context.only
        if only is not None and types.CodeActionKind.QuickFix not in only:
            return []
        if opened is None or opened.checked is not opened.source:
            return []  # places of a text that is no more
        start, end = params.range.start, params.range.end
        chosen = TextRange(Position(start.line, start.character), Position(end.line, end.character))
        repairs = repairs_of(opened.problems, opened.path, chosen)
        return [action_of(repair, address) for repair in repairs]

    @server.feature(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def outlined(params: types.DocumentSymbolParams) -> list[types.DocumentSymbol]:
        opened = server.checks.texts.get(params.text_document.uri)
        return [] if opened is None else symbols_of(opened.view)

    del repaired, outlined
