"""Determines if a stream is an interactive terminal."""

from __future__ import annotations

import os
from typing import TextIO


def is_live(stream: TextIO) -> bool:
    """True if the stream is a terminal that can rewrite lines."""
    return stream.isatty() and not os.environ.get("CI") and os.environ.get("TERM") != "dumb"
