"""Fixtures of the command line, for what is tested through it."""

from __future__ import annotations

from tests.cli.conftest import made_project, msnn, project

__all__ = ["made_project", "msnn", "project"]
