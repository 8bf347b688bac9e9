"""Tells whether somebody watches a stream."""

from __future__ import annotations

import os
from typing import TextIO


def is_live(stream: TextIO) -> bool:
    """Whether the stream is a terminal that can do more than print lines."""
    return stream.isatty() and not os.environ.get("CI") and os.environ.get("TERM") != "dumb"
