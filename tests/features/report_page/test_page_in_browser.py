"""The page of a run in Chromium: it zooms, its model has the bits of the C, all can use it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msnn.api import models
from msnn.api.reports import WrittenReport
from tests.conditions import require_package
from tests.features.report_page.browser import opened, wait

NO_BARS = "[...document.querySelectorAll('.scroll')].every(e => e.offsetWidth - e.clientWidth < 3)"
GOLDEN = "document.getElementById('golden').classList.contains('good')"


@pytest.fixture(scope="module")
def page(written: WrittenReport):
    """The page on a desk, its golden steps checked."""
    require_package("ziglang", "make setup")
    with opened(written.path) as browser:
        wait(browser, GOLDEN)
        yield browser


def test_every_golden_step_gives_the_bits_of_the_interpreter(page: Any):
    said = page.find_element("id", "golden").text
    same, of, count, *_ = said.split()
    assert (of, int(same) > 500) == ("of", True)
    assert same == count


def test_a_changed_bit_is_seen(page: Any):
    found = page.execute_script(
        "const kept = LIVE.expected;"
        "LIVE.expected = kept.replace(/[0-9a-f]{8}\\n/, '12345678\\n');"
        "const found = bench.model.golden(); LIVE.expected = kept; return found;"
    )
    assert found["all"] - found["same"] == 1


def test_buttons_and_drags_zoom(page: Any):
    from selenium.webdriver.common.action_chains import ActionChains

    def view() -> list[float]:
        return page.execute_script("return charts.find((c) => c.place.id === 'record-chart').view")

    place = page.find_element("id", "record-chart")
    first = view()
    place.find_element("css selector", "[aria-label='Zoom in']").click()
    half = view()
    assert half[1] - half[0] == pytest.approx((first[1] - first[0]) / 2)
    place.find_element("css selector", "[aria-label='Move right']").click()
    assert view()[0] > half[0]
    place.find_element("css selector", "[aria-label='Show all']").click()
    assert view() == first
    canvas = place.find_element("css selector", "canvas")
    page.execute_script(
        "arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", canvas
    )
    ActionChains(page).move_to_element(canvas).click_and_hold().move_by_offset(
        200, 0
    ).release().perform()
    dragged = view()
    assert first[0] < dragged[0] < dragged[1] < first[1]
    ActionChains(page).double_click(canvas).perform()
    assert view() == first


def test_the_model_in_the_page_steps_as_the_exported_c(page: Any, trained_run: Path):
    """Played from a record, each output is that of the stepper, which is the C, to the bit."""
    page.execute_script(
        "const c = document.getElementById('live-source'); c.value = '0';"
        "c.dispatchEvent(new Event('change'));"
    )
    page.find_element("id", "live-run").click()
    wait(page, "bench.at >= 40")
    page.find_element("id", "live-run").click()
    played = page.execute_script(
        "const r = bench.record, sample = (n, k) => signal_of(r, n).values[k - signal_of(r, n).at];"
        "return {y: bench.series.outputs[0][0].slice(0, 40),"
        " F: Array.from({length: 40}, (_, k) => sample('F', k)),"
        " start: Object.fromEntries(LIVE.start.map((f) => [f.name, sample(f.signal, f.first)]))}"
    )
    model = models.load(trained_run)
    stepper = models.stepper(model, trained_run)
    stepper.reset(**played["start"])
    expected = [float(stepper.step(F=force)["x_next"]) for force in played["F"]]
    assert np.array_equal(played["y"], expected)


def test_sliders_move_the_model(page: Any):
    page.execute_script(
        "const c = document.getElementById('live-source'); c.value = '';"
        "c.dispatchEvent(new Event('change'));"
        "const s = document.querySelector('#live-inputs input[type=range]'); s.value = 10;"
        "s.dispatchEvent(new Event('input'));"
    )
    for _ in range(3):
        page.find_element("id", "live-step").click()
    found = page.execute_script("return [bench.at, bench.series.inputs[0][0]]")
    assert found == [3, [10.0, 10.0, 10.0]]


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (1280, True), (390, False)])
def test_nobody_is_shut_out(written: WrittenReport, width: int, dark: bool):
    """axe-core finds nothing, nothing is wider than the screen, no script was refused."""
    require_package("axe_selenium_python", "make setup")
    from axe_selenium_python import Axe

    with opened(written.path, width=width, dark=dark) as browser:
        wait(browser, GOLDEN)
        axe: Any = Axe(browser)
        axe.inject()
        violations = axe.run()["violations"]
        assert violations == [], axe.report(violations)
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        assert browser.execute_script(f"return {NO_BARS}")  # what scrolls, scrolls aside
        assert browser.get_log("browser") == []
        assert browser.title.startswith("plant")  # what a doc says is no script
