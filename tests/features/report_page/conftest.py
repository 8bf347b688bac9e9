"""The fixtures of reports."""

from __future__ import annotations

from tests.reports.conftest import trained_run, written

__all__ = ["trained_run", "written"]
