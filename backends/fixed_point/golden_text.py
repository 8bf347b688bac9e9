"""Golden steps as C and as text: words that go in, and those that must come out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from backends.c.c_printer import Printer
from backends.fixed_point.names import FixedNames
from compiler.fixed_point.golden import GoldenRun
from compiler.fixed_point.integer_program import IntegerProgram, WordPort


def golden_facts(
    program: IntegerProgram, names: FixedNames, runs: Sequence[GoldenRun]
) -> dict[str, Any]:
    """What `golden.j2` needs; steps are counted through all runs."""
    tables: list[dict[str, object]] = []
    word = f"{names.prefix}_word_t"

    def table(name: str, values: list[int], type: str = word) -> str:
        suffix = "U" if type == "uint32_t" else ""
        numbers = [f"{value}{suffix}" for value in values]
        text = Printer(names.prefix, "float32").braced(numbers)
        tables.append({"name": name, "type": type, "size": len(values), "numbers": text})
        return f"{names.prefix}_golden_{name}"

    starts = [
        _copy(
            f"x0->{names.windows[port.name]}",
            table(
                f"x0_{names.windows[port.name]}",
                [word for run in runs for word in run.windows[port.name]],
            ),
            port,
            "run",
        )
        for port in program.windows
    ]
    inputs = [
        _copy(
            f"u->{names.inputs[e.port.name]}",
            table(
                f"u_{names.inputs[e.port.name]}",
                [word for run in runs for step in run.inputs for word in step[e.port.name]],
            ),
            e.port,
            "step",
        )
        for e in program.inputs
    ]
    outputs = [
        _compare(
            f"y->{names.outputs[port.name]}",
            table(
                f"y_{names.outputs[port.name]}",
                [word for run in runs for step in run.outputs for word in step[port.name]],
            ),
            port,
        )
        for port, _ in program.outputs
    ]
    table("status", [bits for run in runs for bits in run.status], "uint32_t")
    return {
        "tables": tables,
        "starts": starts or ["(void)run;", "x0->reserved = 0U;"],
        "inputs": inputs or ["(void)u;", "(void)step;"],
        "outputs": outputs or ["(void)y;"],
    }


def expected_text(program: IntegerProgram, runs: Sequence[GoldenRun]) -> str:
    """One line a step: the status, then each word, in hexadecimal digits."""
    digits = program.width.word // 4
    mask = 2**program.width.word - 1
    blocks: list[str] = []
    for run in runs:
        lines: list[str] = []
        for status, answer in zip(run.status, run.outputs, strict=True):
            words = [word for port, _ in program.outputs for word in answer[port.name]]
            lines.append(" ".join([f"{status:08x}", *(f"{w & mask:0{digits}x}" for w in words)]))
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def _copy(field: str, table: str, port: WordPort, counter: str) -> str:
    if not port.axes:
        return f"{field} = {table}[{counter}];"
    source = f"{table}[({counter} * {port.size}U) + i]"
    return f"for (uint32_t i = 0U; i < {port.size}U; i++) {{ {field}[i] = {source}; }}"


def _compare(field: str, table: str, port: WordPort) -> str:
    if not port.axes:
        return f"differing += ({field} != {table}[step]) ? 1U : 0U;"
    test = f"({field}[i] != {table}[(step * {port.size}U) + i])"
    count = f"differing += {test} ? 1U : 0U;"
    return f"for (uint32_t i = 0U; i < {port.size}U; i++) {{ {count} }}"
