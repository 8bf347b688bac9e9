"""Measures what the forward dynamics of an arm of six joints cost: operations, tracing, C.

python benchmarks/robots/measure.py
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[2]))

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import needed
from compiler.ir.program import Program
from compiler.ir.types import Type
from msnn.cli.application import run
from msnn.features.robots.dynamics.members import forward_dynamics
from msnn.features.robots.dynamics.numbers import SignedNode
from msnn.features.robots.dynamics.rigid_bodies import with_masses
from msnn.model.load import load_model
from spec_schema.reading.reader import read_spec

ROOT = Path(__file__).parents[2]
SPEC = """
msnn: 1
name: arm6
sample_time: 10 ms
use: {{arm: {{robot: {{urdf: {urdf}, armature: 0.02}}}}}}
inputs: {{q: {{dims: arm.joint}}, dq: {{dims: arm.joint}}, tau: {{dims: arm.joint}}}}
outputs: {{ddq: "arm.forward_dynamics(q, dq, tau)"}}
export: {{c: {{prefix: arm6, dtype: float64}}}}
"""
CALLS = 200_000
MAIN = """
#include "arm6.h"
#include <stdio.h>
#include <time.h>
int main(void) {
    static arm6_state_t state;
    arm6_in_t in = {{0}};
    arm6_out_t out;
    double *numbers = (double *)&in, sum = 0.0;
    for (unsigned i = 0; i < sizeof in / sizeof *numbers; i++) numbers[i] = 0.1 * (i % 7) - 0.3;
    arm6_init(&state);
    struct timespec a, b;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
    for (int i = 0; i < CALLS; i++) {
        numbers[0] += 1e-9;
        arm6_step(&state, &in, &out);
        sum += *(double *)&out;
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
    double t = (b.tv_sec - a.tv_sec) + 1e-9 * (b.tv_nsec - a.tv_nsec);
    printf("%.3f us a call (%g)\\n", 1e6 * t / CALLS, sum);
    return 0;
}
"""


def operations(program: Program) -> int:
    graph = program.step
    used = needed(graph, [program.output("ddq").node])
    kinds = ops.Add | ops.Subtract | ops.Multiply | ops.Divide | ops.Negate | ops.Apply
    return sum(1 for index, node in graph if used[index] and isinstance(node.op, kinds))


def tracing(path: Path) -> float:
    """Seconds of processor time for the dynamics alone, the best of five."""
    robot = read_spec(path).used["arm"].robot
    assert robot is not None
    best = float("inf")
    for _ in range(5):
        builder = GraphBuilder()
        begun = time.process_time()
        read = [
            [SignedNode(builder, builder.parameter(f"{name}{i}", Type())) for i in range(6)]
            for name in ("q", "dq", "tau")
        ]
        forward_dynamics(with_masses(robot, lambda *_: ()), read)
        best = min(best, time.process_time() - begun)
    return best


def main() -> None:
    with TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "arm6.msnn.yaml"
        urdf = ROOT / "examples" / "z1_friction" / "z1.urdf"
        path.write_text(SPEC.format(urdf=urdf), encoding="utf-8")
        print(f"{operations(load_model(path).program)} live operations")
        print(f"traced in {1000 * tracing(path):.1f} ms")
        out = folder / "c"
        assert run(["export", str(path), "--to", "c", "--out", str(out)]) == 0
        source = folder / "main.c"
        source.write_text(MAIN.replace("CALLS", str(CALLS)).replace("{{0}}", "{0}"))
        files = [str(file) for file in out.rglob("src/*.c")]
        include = [f"-I{out.rglob('include').__next__()}", f"-I{out.rglob('src').__next__()}"]
        for level in ("-O2", "-O3"):
            program = folder / "bench"
            begun = time.perf_counter()
            command = ["gcc", "-std=c99", "-D_POSIX_C_SOURCE=200809L", level, "-march=native"]
            subprocess.run(
                [*command, *include, str(source), *files, "-lm", "-o", str(program)], check=True
            )
            built = time.perf_counter() - begun
            times = [
                subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
                for _ in range(5)
            ]
            print(f"C, gcc {level}, built in {built:.1f} s:", min(times).strip())


if __name__ == "__main__":
    main()
