"""The trace between spec and generated C: every note, its lines, both ways."""

from __future__ import annotations

from pathlib import Path

from backends.c_language.rendering import comment
from msnn.verification.proof.trace import TracedBlock, by_spec_line, traced

PLANT = """\
static float filtered(void)
{
    /* spec: v_next (plant(1).msnn.yaml:27) */
    float sum = 0;
    sum += 1;

    /* spec: plant(1).msnn.yaml:22 */
    return sum;
}

void step(void)
{
    /* spec: v_next
       (plant(1).msnn.yaml:27) */
    filtered();
    /* outputs */
}
"""


def test_blocks_end_at_the_next_comment_or_with_their_function(tmp_path: Path) -> None:
    (tmp_path / "plant.c").write_text(PLANT, encoding="utf-8")
    (tmp_path / "params.c").write_text("/* no statements: spec */\nint k = 1;\n", "utf-8")
    blocks = traced((tmp_path / "params.c", tmp_path / "plant.c"))
    spec = "plant(1).msnn.yaml"
    assert blocks == (
        TracedBlock(file="plant.c", first=3, last=5, name="v_next", spec=spec, line=27),
        TracedBlock(file="plant.c", first=7, last=8, name="", spec=spec, line=22),
        TracedBlock(file="plant.c", first=13, last=15, name="v_next", spec=spec, line=27),
    )
    assert by_spec_line(blocks) == [
        (f"{spec}:22", "", "plant.c:7-8"),
        (f"{spec}:27", "v_next", "plant.c:3-5, plant.c:13-15"),
    ]


def test_names_of_files_may_have_hyphens_and_parentheses(tmp_path: Path) -> None:
    long = " + ".join(["stiffness * travel"] * 4)
    said = [
        f"load [N] = {long} (quarter-car (1).msnn.yaml:31)",
        "quarter-car (1).msnn.yaml:32",
        "slip = a * (b) (quarter-car (1).msnn.yaml:33)",
    ]
    notes = [f"{comment(f'spec: {note}', '    ')}\n    x = 1;\n" for note in said]
    assert notes[0].count("\n") == 3, "the first does not fit in a line"
    (tmp_path / "plant.c").write_text("".join(notes), encoding="utf-8")
    found = [(block.name, block.spec, block.line) for block in traced((tmp_path / "plant.c",))]
    spec = "quarter-car (1).msnn.yaml"
    assert found == [("load", spec, 31), ("", spec, 32), ("slip", spec, 33)]
