"""Says what keeps somebody from using a page of the site, as far as a program can see it."""

from __future__ import annotations

from typing import Any

MODES = [(width, dark) for width in (1280, 390) for dark in (False, True)]
"""A desk and a phone, in columns of pixels, light and dark."""


def faults_of(browser: Any, width: int) -> list[str]:
    """What axe-core finds, what is wider than the screen, and what the console complains of.

    A text or table that scrolls in a box of its own is no wider than its box.
    """
    from axe_selenium_python import Axe

    axe: Any = Axe(browser)
    axe.inject()
    violations = axe.run()["violations"]
    faults = [axe.report([violation]).strip() for violation in violations]
    wide = browser.execute_script("return document.documentElement.scrollWidth")
    if wide > width:
        faults.append(f"is {wide} pixels wide on a screen of {width}")
    return faults + [entry["message"] for entry in browser.get_log("browser")]
