"""Lists what other tools call keys of a spec, for "did you mean"."""

from collections.abc import Mapping

KEYS_ELSEWHERE: Mapping[str, tuple[str, ...]] = {
    "activation_function": ("activation",),
    "batch_size": ("batch",),
    "bounds": ("range",),
    "dense": ("linear",),
    "file": ("source",),
    "files": ("source",),
    "hidden_layers": ("hidden",),
    "hidden_sizes": ("hidden",),
    "initial": ("init",),
    "initial_value": ("init",),
    "iterations": ("epochs",),
    "kernel_size": ("window",),
    "learning_rate": ("lr",),
    "lookup": ("interpolation",),
    "lookup_table": ("interpolation",),
    "lower": ("min",),
    "max_epochs": ("epochs",),
    "n_epochs": ("epochs",),
    "num_epochs": ("epochs",),
    "params": ("parameters",),
    "path": ("source",),
    "sampling_time": ("sample_time",),
    "table": ("interpolation",),
    "taps": ("window",),
    "ts": ("sample_time",),
    "units": ("unit", "hidden"),
    "upper": ("max",),
    "value": ("init",),
    "variables": ("equations",),
}
"""The first that the section has is meant."""
