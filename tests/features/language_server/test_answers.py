"""Hover, definitions and completion answer from the text and the last model that compiled."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.features.language_server.completion import MOST, complete
from msnn.features.language_server.definition import definition
from msnn.features.language_server.hover import hover
from msnn.features.language_server.knowledge import examine
from msnn.features.language_server.positions import Position
from msnn.features.language_server.view import View
from spec_schema.diagnostics.source import SourceText
from tests.features.language_server.marked import PLANT, marked, viewed


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            marked("sum(force[", "sum(fo|rce["),
            "**force**, an input\n\ntype `[wheel=2]`, unit `N`\n\nread at t-3 … t in the step",
        ),
        (
            marked("gain * sum", "ga|in * sum"),
            "**gain**, a parameter\n\ntype `scalar`, unit `1/N`\n\nhow much",
        ),
        (marked("twice(push", "twice(pu|sh"), "**push**, an equation\n\ntype `scalar`, unit `1`"),
        (marked("    push\n", "    pu|sh\n"), "**push**, an equation\n\ntype `scalar`, unit `1`"),
        (marked("  push:", "  pu|sh:"), "**push**, an equation\n\ntype `scalar`, unit `1`"),
        (marked('expr: "twice(', 'expr: "tw|ice('), "**twice**, a function\n\n`twice(a, b)`"),
        (marked("+ past(", "+ pa|st("), "**past**, a layer\n\na fir layer"),
        (marked("* sum(", "* su|m("), "**sum**, 1 argument, `over=`\n\nSum of everything, or over"),
        (marked("speed: {unit: m/s", "speed: {unit: m|/s"), "**m** = 1 m"),
        (marked("doc: how", "do|c: how"), "**doc** of a parameter\n\nWhat it is, for people and"),
        (
            marked("sample_time:", "sample_|time:"),
            "**sample_time** of the spec\n\nTime between two",
        ),
        (marked("dims: wheel", "dims: whe|el"), "**wheel**, a dimension\n\ntype `[wheel=2]`"),
    ],
)
def test_hover(text: str, said: str):
    found = hover(*viewed(text))
    assert found is not None
    assert found.text.startswith(said), found.text


@pytest.mark.parametrize("text", ["|" + PLANT[7:], marked("how much", "how m|uch"), "a: [|]"])
def test_nothing_is_said_of_plain_text(text: str):
    assert hover(*viewed(text)) is None


def test_a_spec_that_never_compiled_shows_what_it_declares():
    text = marked("gain * sum", "ga|in * missing * sum")
    found = hover(*viewed(text, known=""))
    assert found is not None
    assert "**gain**, a parameter" in found.text
    assert "gain: {init: 2 1/N, doc: how much}" in found.text


def test_a_definition_is_where_the_text_has_it_now():
    text = "# a line more\n" + marked("gain * sum", "ga|in * ) sum")
    found = definition(*viewed(text))
    assert found is not None
    assert found.range.start == Position(9, 2)
    of_part = definition(*viewed("# a line more\n" + marked("speed)", "speed.me|as)")))
    assert of_part is not None
    assert of_part.range.start == Position(7, 2)


def test_places_count_utf_16_units():
    view, position = viewed(marked('{expr: "twice(push', '{doc: 𝛼𝛽𝛾𝛿𝜀, expr: "twice(pu|sh'))
    place = Position(position.line, position.character + 5)
    found = hover(view, place)
    assert found is not None
    assert found.text.startswith("**push**")
    proposed = complete(view, place)
    assert proposed is not None
    assert [item.label for item in proposed.items] == ["push"]
    for range in (found.range, proposed.range):
        assert range.start == Position(place.line, place.character - 2)


def test_a_member_is_defined_in_the_file_of_its_sub_model(tmp_path: Path):
    (tmp_path / "part.msnn.yaml").write_text(
        "msnn: 1\nname: part\ninputs: {u: {}}\nparameters:\n  k: 2\noutputs: {y: k * u}\n"
    )
    whole = (
        "msnn: 1\nname: whole\nuse: {p: part.msnn.yaml}\ninputs: {a: {}}\n"
        "connect: {p.u: a}\noutputs: {z: p.y + p.k}\n"
    )
    path = str(tmp_path / "whole.msnn.yaml")
    knowledge = examine(path, whole, {}).knowledge
    assert knowledge is not None
    view = View(SourceText(path, whole), knowledge)
    of_member = definition(view, Position(5, 22))
    assert of_member is not None
    assert (of_member.path, of_member.range.start) == (
        str(tmp_path / "part.msnn.yaml"),
        Position(4, 2),
    )
    of_part = definition(view, Position(5, 19))
    assert of_part is not None
    assert (of_part.path, of_part.range.start) == (path, Position(2, 6))
    of_file = definition(view, Position(2, 12))
    assert of_file is not None
    assert of_file.path == str(tmp_path / "part.msnn.yaml")
    members = complete(view, Position(5, 15))
    assert members is not None
    assert [item.label for item in members.items] == ["p.k", "p.u", "p.y"]
    connected = complete(view, Position(4, 10))
    assert connected is not None
    assert {item.label for item in connected.items} == {"p.k", "p.u", "p.y"}, "no name of its own"
    elsewhere = definition(View(SourceText(path, "\n\n" + whole), knowledge), Position(7, 22))
    assert elsewhere == of_member


@pytest.mark.parametrize("value", ["arm.urdf", "{urdf: arm.urdf}"])
def test_the_file_of_a_robot_is_found_as_that_of_a_spec(value: str, tmp_path: Path):
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>\n")
    use = f"use: {{arm: {{robot: {value}}}}}"
    path = str(tmp_path / "whole.msnn.yaml")
    view, _ = viewed("|" + PLANT)
    view = View(SourceText(path, use), view.knowledge)
    found = definition(view, Position(0, use.index("arm.urdf") + 2))
    assert found is not None
    assert found.path == str(tmp_path / "arm.urdf")


@pytest.mark.parametrize(
    ("text", "some", "none"),
    [
        (marked("sample_time: 10 ms", "samp|"), {"sample_time"}, {"name"}),
        (marked("doc: of the", "r|doc: of the"), {"range"}, {"unit"}),
        (marked("* sum(", "* s|("), {"sum", "sin", "softmax", "speed"}, {"gain"}),
        (marked("* sum(", "* su|"), {"sum"}, {"speed"}),
        (marked("* sum(force[t-3:t])", "* sum(force, o|"), {"over=", "out"}, {"speed"}),
        (marked("* sum(force[t-3:t])", "* sum(force, over=|"), {"wheel"}, {"gain", "sin", "over="}),
        (marked("* sum(force[t-3:t])", "* sum(force, over = w|"), {"wheel"}, set()),
        (marked("* sum(", "* m|("), {"max", "mean"}, {"mse", "mae"}),
        (marked("doc: result", 'predicts: "|"'), {"speed", "force"}, {"gain", "push"}),
        (marked("speed)", "speed.m|)"), {"speed.meas"}, {"speed.past"}),
        (marked("speed)", "gain.|)"), {"gain.past"}, {"gain.meas"}),
        (marked("{unit: m/s}", "{unit: k|}"), {"kg", "kN", "km"}, {"m"}),
        (marked("{unit: m/s}", "{unit: m/s, on_invalid: |}"), {"clamp", "hold"}, {"true"}),
        (marked("dims: wheel", "dims: |"), {"wheel"}, {"gain"}),
        (marked("{fir: {", "{f|ir: {"), {"fir", "fuzzify"}, {"mlp"}),
        (marked("{fir: {", "{fir: {w|"), {"window", "weight"}, {"out"}),
        (marked("expr: 2 * a", "expr: 2 * |"), {"a", "b", "gain"}, set()),
        (PLANT + "train:\n  - {opt|", {"optimizer"}, {"epochs"}),
        (PLANT + "train:\n  - optimizer: a|", {"adam"}, {"sgd"}),
        (PLANT + "losses:\n  l: m|", {"mse", "mae"}, {"gain"}),
        (PLANT + "constants:\n  c: 2 k|", {"kg"}, {"gain"}),
    ],
)
def test_completion(text: str, some: set[str], none: set[str]):
    found = complete(*viewed(text))
    assert found is not None
    labels = {item.label for item in found.items}
    assert some <= labels, labels
    assert not none & labels, labels


@pytest.mark.parametrize("text", [marked("  push:", "  # ga|in\n  push:"), PLANT + "# inp|"])
def test_comments_are_left_alone(text: str):
    view, position = viewed(text)
    assert complete(view, position) is None
    assert hover(view, position) is None


def test_new_names_are_not_proposed():
    found = complete(*viewed(marked("  speed:", "  sp|:")))
    assert found is not None
    assert not found.items


def test_names_that_were_typed_since_are_proposed():
    text = marked("  push:", "  brake: 2 * push\n  more: gain * br|\n  push:")
    found = complete(*viewed(text))
    assert found is not None
    assert [item.label for item in found.items] == ["brake"]


def test_what_is_typed_is_replaced_as_a_whole():
    text = marked("* sum(", "* spe|")
    view, position = viewed(text)
    found = complete(view, position)
    assert found is not None
    assert (found.range.start, found.range.end) == (
        Position(position.line, position.character - 3),
        position,
    )


def test_too_many_proposals_are_said_to_be_some():
    equations = "".join(f"  e{number}: {number} * gain\n" for number in range(2 * MOST))
    found = complete(*viewed(marked("  push:", f"{equations}  more: e|\n  push:")))
    assert found is not None
    assert (len(found.items), found.is_whole) == (MOST, False)
