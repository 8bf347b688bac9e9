"""Small programs in window form, each with a log that fits it, for tests of passes and backends."""

from __future__ import annotations

from collections.abc import Callable

from tests.sample_programs.fir_closed_loop import fir_closed_loop
from tests.sample_programs.fuzzy_local_models import fuzzy_local_models
from tests.sample_programs.joint_arm import joint_arm
from tests.sample_programs.late_sensor import late_sensor
from tests.sample_programs.preview_driver import preview_driver
from tests.sample_programs.sample import Log, Sample
from tests.sample_programs.spring_damper_rk4 import spring_damper_rk4

__all__ = [
    "SAMPLES",
    "Log",
    "Sample",
    "fir_closed_loop",
    "fuzzy_local_models",
    "joint_arm",
    "late_sensor",
    "preview_driver",
    "spring_damper_rk4",
]

SAMPLES: dict[str, Callable[[], Sample]] = {
    "fir_closed_loop": fir_closed_loop,
    "spring_damper_rk4": spring_damper_rk4,
    "fuzzy_local_models": fuzzy_local_models,
    "joint_arm": joint_arm,
    "preview_driver": preview_driver,
    "late_sensor": late_sensor,
}
