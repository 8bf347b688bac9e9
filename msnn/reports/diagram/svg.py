"""Draws the architecture of a spec as SVG, without further programs, fonts or scripts."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from html import escape
from pathlib import Path

import templates
from msnn.reports.diagram.flow import SHOWN, Box, Flow, Wire, flow_of
from msnn.reports.diagram.layers import BoxPlace, DiagramLayout, Size, laid_out
from spec_schema.sections.spec import Spec

_STYLE = Path(templates.__path__[0]) / "report" / "diagram.css"
_MARGIN, _LANE = 16.0, 14.0
_LINE, _PADDING = 16.0, 11.0
_LETTER = 7.4
"""Width of a letter in px, slightly above the average of 13 px fonts."""
# all of it stands in the <title>, which browsers show when one points at the box
_MOST_LETTERS = 30
_LEAST_WIDTH = 66.0


def architecture_svg(spec: Spec, *, styled: bool = True) -> str:
    """Inputs on the left, outputs on the right, feedback of states below.

    With `styled` the SVG has its own light and dark style; otherwise the page defines the classes.
    """
    flow = flow_of(spec)
    sizes = {box.name: _size(box) for box in flow.boxes}
    layout = laid_out(flow, sizes)
    lanes = _lanes(flow, layout)
    # a lane on either side for wires that go back, one below each for those that they feed
    width = layout.width + 2 * _MARGIN + (_LANE * 2 if lanes else 0)
    height = layout.height + 2 * _MARGIN + _LANE * (len(lanes) + (1 if lanes else 0))
    name = spec.name.value
    # an image to readers of screens; the parts inside have titles of their own
    label = escape(f"Architecture of {name}: {_summary(flow)}", quote=True)
    size = f'viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}"'
    head = f'class="diagram" role="img" aria-label="{label}" {size}'
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" {head}>']
    if styled:
        lines.append(f"<style>\n{_STYLE.read_text(encoding='utf-8')}</style>")
        lines.append('<rect class="paper" width="100%" height="100%"/>')
    lines.append(f'<g transform="translate({_MARGIN + (_LANE if lanes else 0):g} {_MARGIN:g})">')
    lines += _forward(flow, layout)
    lines += _back(lanes, layout)
    for box in flow.boxes:
        lines += _drawn(box, layout.places[box.name])
    return "\n".join([*lines, "</g>", "</svg>"])


def _summary(flow: Flow) -> str:
    named = {kind: [box.name for box in flow.boxes if box.kind == kind] for kind in SHOWN}
    return "; ".join(f"{kind} {', '.join(names)}" for kind, names in named.items() if names)


def _texts(box: Box) -> tuple[str, str, str]:
    """The texts of a box: its name, its kind, its parameters."""
    uses = ", ".join(box.uses)
    return _short(box.name), _short(box.about), _short(uses)


def _short(text: str) -> str:
    # names of files are free: control characters are no XML 1.0 at all, escaped or not
    text = "".join(c if c.isprintable() else " " for c in text)
    return text if len(text) <= _MOST_LETTERS else f"{text[: _MOST_LETTERS - 1]}…"


def _size(box: Box) -> Size:
    name, about, uses = _texts(box)
    first = _width(name) + (_width(about) * 0.88 + 8 if about else 0)
    width = max(first, _width(uses) * 0.88, _LEAST_WIDTH - 2 * _PADDING) + 2 * _PADDING
    return Size(width, 2 * _PADDING + _LINE * (2 if uses else 1) - 4)


def _width(text: str) -> float:
    # no font is measured, as none may be installed: letters of two columns are nearly twice as wide
    wide = sum(unicodedata.east_asian_width(character) in "WF" for character in text)
    return (len(text) + 0.8 * wide) * _LETTER


def _drawn(box: Box, place: BoxPlace) -> Iterator[str]:
    name, about, uses = _texts(box)
    full = " ".join(filter(None, (box.name, box.about)))
    if box.uses:
        full += f", uses {', '.join(box.uses)}"
    round = place.height / 2 if box.kind in ("inputs", "outputs") else 5
    yield f'<g class="box {box.kind}"><title>{escape(full)}</title>'
    yield (
        f'<rect x="{place.x:.1f}" y="{place.y:.1f}" width="{place.width:.1f}" '
        f'height="{place.height:.1f}" rx="{round:g}"/>'
    )
    middle = place.x + place.width / 2
    y = place.y + _PADDING + _LINE * 0.62
    unit = f'<tspan class="about" dx="7">{escape(about)}</tspan>' if about else ""
    yield f'<text x="{middle:.1f}" y="{y:.1f}"><tspan>{escape(name)}</tspan>{unit}</text>'
    if uses:
        yield f'<text class="uses" x="{middle:.1f}" y="{y + _LINE:.1f}">{escape(uses)}</text>'
    yield "</g>"


def _forward(flow: Flow, layout: DiagramLayout) -> Iterator[str]:
    for wire in flow.forward:
        source, target = layout.places[wire.source], layout.places[wire.target]
        points = [
            (source.x + source.width, source.middle),
            *layout.paths[wire],
            (target.x - 5, target.middle),
        ]
        path = [f"M{points[0][0]:.1f} {points[0][1]:.1f}"]
        # points come in pairs: a curve crosses the gap, a line the layer between two bends
        for number in range(0, len(points) - 1, 2):
            (x1, y1), (x2, y2) = points[number], points[number + 1]
            half = (x1 + x2) / 2
            path.append(f"C{half:.1f} {y1:.1f} {half:.1f} {y2:.1f} {x2:.1f} {y2:.1f}")
            if number + 2 < len(points):
                path.append(f"L{points[number + 2][0]:.1f} {points[number + 2][1]:.1f}")
        yield f'<path class="wire" d="{" ".join(path)}"/>'
        yield _arrow(target.x, target.middle, "wire-head")


def _lanes(flow: Flow, layout: DiagramLayout) -> dict[str, list[Wire]]:
    """The feedback wires into each box, one lane per box below the diagram."""
    found: dict[str, list[Wire]] = {}
    for wire in flow.back:
        found.setdefault(wire.target, []).append(wire)
    # the rightmost box has the lane nearest to it, so that lanes do not cross
    return dict(sorted(found.items(), key=lambda item: -layout.places[item[0]].x))


def _back(lanes: dict[str, list[Wire]], layout: DiagramLayout) -> Iterator[str]:
    """Feedback paths: from the source's right end, below all boxes, to the target's left end."""
    for number, (name, wires) in enumerate(lanes.items()):
        lane = layout.height + _LANE * (number + 1)
        target = layout.places[name]
        # a few offsets in turn keep parallel wires apart
        left = target.x - 8 - _LANE * 0.5 * (number % 3)
        # below the middle, where wires forward come in
        entry = target.middle + target.height / 4
        for wire in wires:
            source = layout.places[wire.source]
            out = source.x + source.width
            right = out + 8 + 5 * (number % 5)
            exit = source.middle + source.height / 4
            yield (
                f'<path class="back" d="M{out:.1f} {exit:.1f} H{right - 4:.1f} '
                f"q4 0 4 4 V{lane - 4:.1f} q0 4 -4 4 H{left + 4:.1f} "
                f'q-4 0 -4 -4 V{entry + 4:.1f} q0 -4 4 -4 H{target.x - 5:.1f}"/>'
            )
        yield _arrow(target.x, entry, "back-head")


def _arrow(x: float, y: float, kind: str) -> str:
    return f'<path class="{kind}" d="M{x:.1f} {y:.1f} l-8 -3.6 v7.2 z"/>'
