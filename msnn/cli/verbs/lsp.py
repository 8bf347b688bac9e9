"""`msnn lsp`: a language server for editors, over the standard streams."""

from __future__ import annotations


def lsp() -> None:
    """Serve an editor (Language Server Protocol).

    Diagnostics of `msnn check`, hover, definitions, completion and repairs while you type, over
    standard input and output. An editor starts it; needs the extra `lsp`.
    """
    from msnn.packages import PYGLS

    PYGLS.require("speaks the protocol of editors")
    from msnn.features.language_server.server import serve

    serve()
