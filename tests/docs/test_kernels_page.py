"""docs/kernels.md is what `benchmarks/kernel_accuracy` makes of its results."""

from __future__ import annotations

from benchmarks.kernel_accuracy.report import DOCUMENT, report


def test_the_page_is_that_of_the_results(accept: bool):
    if accept:
        DOCUMENT.write_text(report(), encoding="utf-8")
    assert DOCUMENT.read_text(encoding="utf-8") == report()
