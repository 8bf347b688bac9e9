"""Lists what other tools call keys of a spec, for the help lines of unknown keys."""

from collections.abc import Mapping

KEYS_ELSEWHERE: Mapping[str, tuple[str, ...]] = {
    "activation_function": ("activation",),
    "batch_size": ("batch",),
    "bounds": ("range",),
    "comment": ("doc",),
    "ddt": ("der",),
    # of several the entry decides: a parameter has `init`, a constant `value`
    "default": ("init", "value"),
    "dense": ("linear",),
    "derivative": ("der",),
    "description": ("doc",),
    "dot": ("der",),
    "dt": ("sample_time",),
    "dxdt": ("der",),
    "early_stopping": ("early_stop",),
    "equation": ("expr",),
    "file": ("source",),
    "files": ("source",),
    "formula": ("expr",),
    "fully_connected": ("linear",),
    "hidden_layers": ("hidden",),
    "hidden_sizes": ("hidden",),
    "init": ("value",),
    "initial": ("init", "value"),
    "initial_value": ("init", "value"),
    "iterations": ("epochs",),
    "kernel_size": ("window",),
    "layers": ("hidden",),
    "learning_rate": ("lr",),
    "lookup": ("interpolation",),
    "lookup_table": ("interpolation",),
    "loss": ("expr", "losses"),
    "lower": ("min",),
    "max_epochs": ("epochs",),
    "n_epochs": ("epochs",),
    "neurons": ("hidden",),
    "nn": ("mlp",),
    "num_epochs": ("epochs",),
    "optim": ("optimizer",),
    "params": ("parameters",),
    "path": ("source",),
    "sampling_time": ("sample_time",),
    "scheduler": ("schedule",),
    # a key of `layers:`, where people look for what other tools call so
    "table": ("interpolation",),
    "taps": ("window",),
    "trainable": ("learn",),
    "ts": ("sample_time",),
    "units": ("unit", "hidden"),
    "upper": ("max",),
    "value": ("init",),
    "variables": ("equations",),
}
"""The first that the section has is meant."""

FORMS_ELSEWHERE: Mapping[str, tuple[str, str]] = {
    # keys of a stage, written into the options of its optimizer: `lr` shows that these are such
    "batch": ("lr", "`batch: …` beside `optimizer:`, in the stage"),
    "bounds": ("min", "`min: …` and `max: …`"),
    "clip": ("lr", "`clip: …` beside `optimizer:`, in the stage"),
    "early_stop": ("lr", "`early_stop: {patience: …}` beside `optimizer:`, in the stage"),
    "epochs": ("lr", "`epochs: …` beside `optimizer:`, in the stage"),
    "limits": ("min", "`min: …` and `max: …`"),
    "patience": ("early_stop", "`early_stop: {patience: …}`"),
    "range": ("min", "`min: …` and `max: …`"),
    "schedule": ("lr", "`schedule: …` beside `optimizer:`, in the stage"),
    "weight_decay": ("lr", "`weight_decay: …` beside `optimizer:`, in the stage"),
}
"""A key that the section must have, and what is written there, where one word is not enough."""
