"""Builds training kernels of arms with more and more joints and tells how long each part takes.

python benchmarks/kernel_build/run.py            # 3 6 12 24 joints: the table of RESULTS.md
python benchmarks/kernel_build/run.py 6
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from written_out_arm import written_out_arm

from backends.native.compile_kernel import compiled_kernel
from backends.native.kernel_source import kernel_source
from compiler.differentiation.training_step import training_step
from compiler.elaboration.compile import compile_spec
from spec_schema.reading.reader import read_spec


def main() -> None:
    sizes = [int(size) for size in sys.argv[1:]] or [3, 6, 12, 24]
    print("| joints | nodes forward / reverse | msnn, s | compiler, s |")
    print("| --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as cache:
        os.environ["MSNN_CACHE"] = cache
        for joints in sizes:
            print(_measured(joints), flush=True)


def _measured(joints: int) -> str:
    """A row of the table: CPU time of the generator and of the C compiler."""
    began = time.process_time()
    spec = read_spec("arm.msnn.yaml", written_out_arm(joints)).spec
    step = training_step(compile_spec(spec).program)
    source = kernel_source(step, "float32")
    own = time.process_time() - began
    before = _children()
    compiled_kernel(source.text, on_lanes=True)
    compiler = _children() - before
    nodes = f"{len(step.program.step):,} / {len(step.reverse_step.graph):,}"
    return f"| {joints} | {nodes} | {own:.2f} | {compiler:.2f} |"


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
