"""Diagrams of architectures: boxes apart, text inside, wires left to right, feedback below."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ElementTree
from itertools import combinations
from pathlib import Path

import pytest

from msnn.model.load import load_model
from msnn.reports.diagram.flow import Wire, flow_of
from msnn.reports.diagram.svg import architecture_svg
from spec_schema.reading.reader import read_spec

ROOT = Path(__file__).resolve().parents[2]
SPECS = sorted((ROOT / "examples" / "gallery").glob("*.msnn.yaml"))
SVG = "{http://www.w3.org/2000/svg}"
FEW = """
msnn: 1
name: few
sample_time: 0.1 s
inputs: {u: {doc: force}}
parameters: {k: {init: 1}}
layers: {h: {fir: {window: 2}}}
states: {x: {next: x + k * h(u), init: 0}}
equations: {e: 2 * x}
outputs: {y: {expr: e, predicts: "u[t+1]"}}
"""


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.name.partition(".")[0])
def test_boxes_of_the_gallery_stand_apart_and_hold_their_text(path: Path):
    svg = ElementTree.fromstring(architecture_svg(load_model(path).spec))  # noqa: S314  (ours)
    boxes: list[tuple[float, float, float, float]] = []
    for group in svg.iter(f"{SVG}g"):
        rect = group.find(f"{SVG}rect")
        if not group.get("class", "").startswith("box") or rect is None:
            continue
        x, y, width, height = (float(rect.get(k, "")) for k in ("x", "y", "width", "height"))
        boxes.append((x, y, x + width, y + height))
        for text in group.iter(f"{SVG}text"):
            # the widest letters of DejaVu Sans, the widest usual font, are on average 0.6 em
            letters = len("".join(text.itertext()))
            assert letters * 0.6 * 11.5 <= width
            assert y < float(text.get("y", "")) < y + height
    assert boxes
    for a, b in combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
    right, bottom = map(float, svg.get("viewBox", "").split()[2:])
    assert all(x2 < right and y2 < bottom for _, _, x2, y2 in boxes)


def test_arguments_go_into_layers_and_states_feed_back():
    spec = read_spec(Path("few.yaml"), FEW, ()).spec
    flow = flow_of(spec)
    assert set(flow.forward) == {Wire("u", "h"), Wire("x", "e"), Wire("e", "y")}
    assert set(flow.back) == {Wire("x", "x"), Wire("h", "x"), Wire("y", "u")}
    (state,) = [box for box in flow.boxes if box.kind == "states"]
    assert state.uses == ("k",)


def test_names_are_text():
    text = FEW.replace("name: few", 'name: few\ndoc: "<script>"')
    spec = read_spec(Path("few.yaml"), text, ()).spec
    svg = architecture_svg(spec, styled=False)
    assert "<style" not in svg
    assert {e.tag for e in ElementTree.fromstring(svg).iter()} == {  # noqa: S314  (ours)
        f"{SVG}{tag}" for tag in ("svg", "g", "title", "rect", "text", "tspan", "path")
    }


def test_a_chain_may_be_longer_than_the_stack_is_deep():
    # each equation uses the next one below it, more of them than Python lets calls nest
    count = sys.getrecursionlimit() + 100
    chain = ", ".join(f"e{i}: e{i + 1} + 1" for i in range(count))
    text = f"""
msnn: 1
name: chain
sample_time: 1 s
inputs: {{u: {{}}}}
equations: {{{chain}, e{count}: u + 1}}
outputs: {{y: e0}}
"""
    svg = architecture_svg(read_spec(Path("chain.yaml"), text, ()).spec)
    assert svg.count('class="box equations"') == count + 1
