"""What each key of the `train` section is for, in a line."""

from collections.abc import Mapping

_EACH = "What the rate is multiplied by."
_LR = "Step length of the optimiser."

TRAINING_DOCS: Mapping[str, Mapping[str, str]] = {
    "Stage": {
        "name": "Name of the stage in reports.",
        "epochs": "Most passes over the data.",
        "batch": "Rollouts a step.",
        "optimizer": "The optimiser; `adam` by default.",
        "losses": "Weights of losses in this stage.",
        "freeze": "Parameters that keep their values; `*` stands for any text.",
        "lr": "Factors of the step length of single parameters.",
        "schedule": "How the learning rate goes down.",
        "clip": "Longest gradient.",
        "rollout": "How far predictions are fed back; one step by default.",
        "early_stop": "When to end before all epochs.",
        "seed": "Seed of the shuffling.",
        "dtype": "Precision of the arithmetic.",
        "engine": "What computes: native kernels or torch.",
        "threads": "Threads of the native engine; any number gives the same bits.",
        "reproducible": "Insists on kernels with the same bits on every processor.",
        "starts": "Runs from different initial values, of which the best goes on.",
        "weight_decay": "Pull of the weights towards 0.",
    },
    "Rollout": {
        "horizon": "Steps or duration of a run, `episode` or `record`.",
        "stride": "Distance of the starts.",
        "skip": "First part that is not scored.",
        "close": "Inputs that are fed back; all that can be by default.",
        "curriculum": "Shorter horizons, each up to the end of an epoch.",
    },
    "Schedule": {
        "cosine": "Half a cosine.",
        "exponential": "The same factor after each epoch.",
        "step": "A factor after each so many epochs.",
        "plateau": "A factor when the monitor gets no better.",
    },
    "Cosine": {"to": "Share of the rate that is left at the end."},
    "Exponential": {"factor": _EACH},
    "Step": {"every": "Epochs between two reductions.", "factor": _EACH},
    "Plateau": {
        "patience": "Epochs without a better monitor.",
        "factor": _EACH,
        "least": "Share of the rate below which it never goes.",
    },
    "EarlyStop": {
        "monitor": "Loss that is watched; the total by default.",
        "patience": "Epochs without a better value.",
    },
    "Adam": {
        "lr": _LR,
        "beta1": "Decay of the mean.",
        "beta2": "Decay of the square.",
        "eps": "Least divisor.",
    },
    "AdamW": {
        "lr": _LR,
        "beta1": "Decay of the mean.",
        "beta2": "Decay of the square.",
        "eps": "Least divisor.",
    },
    "Sgd": {"lr": _LR, "momentum": "How much of the last step is kept."},
    "TorchOptimizer": {
        "name": "Class of torch.optim, such as `RAdam`.",
        "options": "Arguments of the class.",
    },
    "Lbfgs": {
        "lr": _LR,
        "history": "Steps from which the curvature is estimated.",
        "iterations": "Steps an epoch.",
    },
    "LevenbergMarquardt": {
        "damping": "Of the first step, relative to the curvature in each parameter.",
        "tolerance": "Relative change of the total at which the stage ends.",
    },
}
