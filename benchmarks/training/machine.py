"""Measures the speed of the machine, and if other programs are running."""

from __future__ import annotations

import os
import platform
import subprocess
import tempfile
from pathlib import Path

QUIET = 1.5
"""Load average up to which a measurement is judged: the benchmark itself makes 1 of it."""


def fma_peak() -> float:
    """GFLOP/s of float32 multiply-adds on one core, the best of five runs."""
    source = Path(__file__).parent / "fma_peak.c"
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "fma_peak"
        flags = ["-O3", "-march=native", "-ffp-contract=fast"]
        subprocess.run(["gcc", *flags, "-o", program, source], check=True)
        told = subprocess.run([program], check=True, capture_output=True, text=True)
    return float(told.stdout.split()[0])


def processor() -> str:
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {os.cpu_count()} cores"


def load() -> float:
    """The mean number of processes that were ready to run during the last minute."""
    return os.getloadavg()[0]


def stay_on_one_core() -> None:
    """Restricts this process and those that it starts to the last core, so that none has two
    threads.
    """
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
