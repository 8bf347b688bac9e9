"""Opens pages in Chromium without a window, as wide as a desk or a phone, light or dark."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.conditions import require_package, require_tool


@contextmanager
def opened(page: Path, *, width: int = 1280, dark: bool = False) -> Generator[Any]:
    """A driver with the page; what a page of this width shows of phones is set too."""
    with chromium(width=width, dark=dark) as browser:
        browser.get(page.as_uri())
        yield browser


@contextmanager
def chromium(*, width: int, dark: bool) -> Generator[Any]:
    """A driver for one page after the other."""
    program = require_tool("chromium", "apt install chromium")
    driver = require_tool("chromedriver", "apt install chromium-driver")
    require_package("selenium", "make setup")
    from selenium.webdriver import Chrome
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = program
    for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser: Any = Chrome(options=options, service=Service(driver))
    try:
        screen = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        yield browser
    finally:
        browser.quit()


def wait(browser: Any, condition: str) -> None:
    """Until an expression of the page is true."""
    from selenium.webdriver.support.ui import WebDriverWait

    def holds(_: Any) -> bool:
        return bool(browser.execute_script(f"return ({condition})"))

    WebDriverWait(browser, 60).until(holds)
