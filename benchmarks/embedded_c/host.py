"""Measures nanoseconds per step on this machine, of generated C and of onnxruntime."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import numpy as np
import onnxruntime
from board import HARNESS, LEVELS
from contenders import Contender


def host_nanoseconds(contender: Contender, folder: Path) -> float:
    """Nanoseconds per step at the fastest optimisation level of gcc."""
    times: list[float] = []
    for level in LEVELS:
        program = folder / f"host{level}"
        includes = [f"-I{path}" for path in (contender.folder, HARNESS, *contender.includes)]
        head = ["gcc", "-std=gnu11", level, "-ffp-contract=off", *contender.flags, *includes]
        files = [HARNESS / "host.c", *contender.sources]
        subprocess.run([*head, *files, "-o", program, "-lm"], check=True, capture_output=True)
        said = subprocess.run([program], check=True, capture_output=True, text=True).stdout
        times.append(float(said))
    return min(times)


def onnxruntime_nanoseconds(model: Path, calls: int = 20_000) -> float:
    """Nanoseconds per call from Python, on one thread."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(model, options)
    u, v, history = np.float32(1.0), np.float32(0.0), np.zeros(24, np.float32)
    best = float("inf")
    for _ in range(3):
        begin = time.perf_counter()
        for _ in range(calls):
            ports = {"u": np.asarray(u), "v": np.asarray(v), "u_history": history}
            _, v, history = session.run(None, ports)
        best = min(best, (time.perf_counter() - begin) / calls)
    return best * 1e9
