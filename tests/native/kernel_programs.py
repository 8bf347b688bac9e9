"""A training kernel as a program of its own: made by any compiler, run on any processor.

It takes the losses and slopes of some rollouts, trains their batches by Adam, and prints the bits
of all that it found.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.c_language.literals import Dtype
from backends.native.compile_kernel import kernel_flags
from backends.native.kernel_source import kernel_source
from backends.raw_parameters import mapping_of, raw_value
from compiler.differentiation.training_step import training_step
from compiler.ir.program import Program
from tests.native.test_kernel import flat, initial, log_of

STEPS, ROLLOUTS, BATCH, EPOCHS = 20, 100, 24, 2

_PROGRAM = """
#include <stdio.h>
#include <stdlib.h>
#include <inttypes.h>

{arrays}

static void show(const char *name, const void *numbers, size_t bytes)
{{
    const unsigned char *const each = numbers;
    printf("%s", name);
    for (size_t i = 0; i < bytes; i++) {{
        printf("%02x", each[i]);
    }}
    printf("\\n");
}}

int main(void)
{{
    enum {{ BATCHES = ({rollouts} + {batch} - 1) / {batch} }};
    static struct group groups[{rollouts}];
    int64_t starts[{rollouts}], members[{rollouts}], bounds[BATCHES + 1] = {{0}};
    for (int64_t i = 0; i < {rollouts}; i++) {{
        starts[i] = 10 + i;
    }}
    msnn_shuffled(7, {rollouts}, members);
    msnn_groups(starts, members, {rollouts}, {batch}, {steps}, groups);
    for (int64_t b = 0; b < BATCHES; b++) {{
        const int64_t own = b + 1 < BATCHES ? {batch} : {rollouts} - b * {batch};
        bounds[b + 1] = bounds[b] + (own + GROUP - 1) / GROUP;
    }}
    const struct problem p = {{series, ROWS, NULL, 2}};
    struct work w = {{NULL, {steps}, bounds[BATCHES], 1, 1, 0, 1, NULL}};
    w.memory = aligned_alloc(64, ((size_t)msnn_work_bytes(&w) + 63) / 64 * 64);
    real first[PARAMETERS] = {{0}}, second[PARAMETERS] = {{0}}, gradient[PARAMETERS];
    double sums[LOSSES], counts[LOSSES], weights[LOSSES];
    for (int l = 0; l < LOSSES; l++) {{
        weights[l] = 0.7;
    }}
    struct variables v = {{kind, low, high, scale, rate, raw, physical, first, second}};
    msnn_physical(&v);
    show("start    ", physical, sizeof physical);
    msnn_losses(&p, groups, bounds[BATCHES], physical, weights, 0, &w, gradient, sums, counts);
    show("losses   ", sums, sizeof sums);
    show("gradient ", gradient, sizeof gradient);
    struct optimizer o = {{ADAM, 0, 0.9, 0.999, 1e-8, 1e-3, 0.5, 0}};
    for (int epoch = 0; epoch < {epochs}; epoch++) {{
        for (int l = 0; l < LOSSES; l++) {{
            sums[l] = counts[l] = 0;
        }}
        const int64_t done = msnn_train(&p, groups, bounds, BATCHES, &v, &o, weights, &w, sums,
                                        counts);
        printf("%d of %d\\n", (int)done, BATCHES);
        show("losses   ", sums, sizeof sums);
        show("weights  ", physical, sizeof physical);
    }}
    return 0;
}}
"""


@dataclass(frozen=True, slots=True)
class Machine:
    """A compiler with the processor it compiles for, and what runs its programs."""

    compiler: tuple[str, ...]
    runner: tuple[str, ...] = ()


def kernel_program(program: Program, dtype: Dtype, *, reproducible: bool = False) -> str:
    """The C of the program."""
    source = kernel_source(training_step(program), dtype, reproducible=reproducible)
    weights = initial(program)
    log = log_of(program, ROLLOUTS + STEPS + 20)
    parameters = program.parameters

    def each(values: Iterable[tuple[float, str]]) -> list[float]:
        return [float(x) for value, name in values for x in [value] * weights[name].size]

    raws = np.concatenate([raw_value(p, weights[p.name])[0].ravel() for p in parameters])
    arrays = [
        _array("double", "low", each((p.minimum or 0.0, p.name) for p in parameters)),
        _array("double", "high", each((p.maximum or 0.0, p.name) for p in parameters)),
        _array("double", "scale", each((p.scale, p.name) for p in parameters)),
        _array("int32_t", "kind", each((float(mapping_of(p)), p.name) for p in parameters)),
        _array("real", "rate", [0.01] * raws.size),
        _array("real", "raw", raws.tolist()),
        _array("real", "physical", flat(program, weights).tolist()),
    ]
    names = [f"series_{number}" for number, _ in enumerate(source.signals)]
    for name, signal in zip(names, source.signals, strict=True):
        arrays.append(_array("real", name, log[signal].ravel().tolist()))
    arrays.append(f"static const real *const series[] = {{{', '.join(names)}}};")
    arrays.append(f"#define ROWS {ROLLOUTS + STEPS + 20}")
    body = _PROGRAM.format(
        arrays="\n".join(arrays), rollouts=ROLLOUTS, batch=BATCH, steps=STEPS, epochs=EPOCHS
    )
    return f"{source.text}\n{body}"


def output(text: str, machine: Machine, folder: Path) -> str:
    """What the program prints where it was compiled by the flags of kernels."""
    known = kernel_flags(machine.compiler, on_lanes=True)
    flags = [flag for flag in known if flag not in {"-shared", "-fPIC", "-march=native"}]
    made = folder / "program"
    command = [*machine.compiler, *flags, "-static", "-o", str(made), "-x", "c", "-", "-lm"]
    subprocess.run(command, input=text, check=True, text=True, timeout=300)
    return _ran([*machine.runner, str(made)])


def _ran(command: Sequence[str]) -> str:
    done = subprocess.run(command, check=True, text=True, capture_output=True, timeout=300)
    return done.stdout


def _array(type: str, name: str, values: Sequence[float]) -> str:
    numbers = [str(int(value)) if type == "int32_t" else value.hex() for value in values]
    return f"static {type} {name}[] = {{{', '.join(numbers)}}};"
