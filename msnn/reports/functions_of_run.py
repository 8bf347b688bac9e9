"""Loads the functions that a run has learned, for plotting."""

from __future__ import annotations

from msnn.model.load import load_model
from msnn.model.model_data import read_data, sources_of
from msnn.model.saved_run import WEIGHTS
from msnn.model.weights.weights_file import read_weights
from msnn.reports.learned_functions import LearnedFunction, learned_functions
from msnn.reports.run_summary import Run
from spec_schema.diagnostics.diagnostic import SpecError


def functions_of_run(run: Run) -> tuple[LearnedFunction, ...]:
    """Functions over the range of the run's data, if available; empty without weights."""
    weights = run.folder / WEIGHTS
    if not weights.is_file():
        return ()
    # as the run has kept it: the file of the spec may have changed since
    model = load_model(run.folder)
    try:
        data = read_data(model, None, "picture")
    except SpecError:  # a run does not keep its data: taps need none
        data = None
    with sources_of(model):
        return learned_functions(model, read_weights(weights, model.program), data)
