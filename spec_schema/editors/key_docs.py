"""What each key of a spec is for, in a line: what editors show, and the reference page of keys."""

from collections.abc import Mapping

from spec_schema.editors.key_docs_training import TRAINING_DOCS
from spec_schema.fields.entry import Entry
from spec_schema.fields.entry_kinds import about, kinds_of

_UNIT = "Unit of measurement such as `m/s`; checked where both sides declare one."
_DIMS = "Named dimensions of the value, in order."
_DOC = "What it is, for people and for generated code."
_INIT = "Initial weights; small random numbers by default."
_OUT = "Dimension of the result; a scalar by default."
_DROPOUT = "Share of the elements that training leaves out at random."
_BIAS = "Whether a learned constant is added."
_GIVEN_BIAS = "Whether a learned constant is added, or the parameter that it is."
_WEIGHT = "Parameter that the weights are; by default they are the layer's own."
_FIT = "Logged signal, `y[t+k]`, whose training rows it is fitted to before the first stage."
_RATE = "How often it falls by e from end to end."
_ALONG = "Dimension along which the values change; by default the last axis."
_PREFIX = "What generated names start with; by default the name of the spec."

# What a key means wherever it stands, unless there is more to say.
_EVERYWHERE: Mapping[str, str] = {
    "bias": _BIAS,
    "dims": _DIMS,
    "doc": _DOC,
    "out": _OUT,
    "prefix": _PREFIX,
    "substeps": "Steps of the integrator a sample.",
    "unit": _UNIT,
}
_DOCS: Mapping[str, Mapping[str, str]] = {
    **TRAINING_DOCS,
    "Spec": {
        "msnn": "Version of the language: 1.",
        "name": "Name of the model; generated code and files bear it.",
        "doc": _DOC,
        "sample_time": "Time between two samples, or a frequency; a model without it is static.",
        "dims": "Named dimensions: their size, or the labels of their elements.",
        "use": "Other specs that are parts of this one, by the names they have here.",
        "inputs": "Signals that the model reads, logged and deployed.",
        "targets": "Signals that only training and metrics read.",
        "constants": "Numbers that are fixed when the spec is compiled.",
        "parameters": "Values that training learns.",
        "layers": "Functions with weights, called by their names.",
        "functions": "Formulas with arguments, written out where they are called.",
        "states": "Memory of the model: continuous (`der`) or discrete (`next`).",
        "integrator": "How continuous states go from sample to sample; `rk4` by default.",
        "equations": "Named expressions, in any order.",
        "connect": "What feeds the inputs of sub-models: `plant.u: expression`.",
        "outputs": "Results of the model.",
        "losses": "Terms that training makes small, beside those of `predicts`.",
        "data": "Measured files and which column is which signal.",
        "train": "Stages of training, each from the best weights of the one before.",
        "validate": "What is measured of the trained model, with limits.",
        "export": "What `msnn export` writes.",
    },
    "Use": {
        "spec": "File of the spec, relative to this one.",
        "weights": "File of weights that a training of it wrote; initial values without it.",
        "freeze": "Parameters that are constants here: `all`, `none` or a list; `*` is any text.",
    },
    "Connection": {
        "expr": "What the input is, in the same step and in its past.",
        "history": "Values of the input before the start.",
    },
    "Signal": {
        "unit": _UNIT,
        "dims": _DIMS,
        "range": "Lowest and highest value that is plausible, numbers in its unit or with one.",
        "on_invalid": "What generated code does with a sample that is NaN or out of range.",
        "doc": _DOC,
    },
    "Constant": {"value": "The numbers, or an expression of them.", "dims": _DIMS, "unit": _UNIT},
    "Parameter": {
        "init": "Value before training: numbers, an expression, or how they are drawn.",
        "min": "Bound that training never goes below.",
        "max": "Bound that training never goes above.",
        "unit": _UNIT,
        "dims": _DIMS,
        "scale": "Typical size; the optimiser works on the value divided by it.",
        "learn": "Whether training changes it.",
    },
    "Initializer": {
        "value": "Numbers, or an expression of the indices i, j, … of the array.",
        "file": "File of numbers, relative to the spec.",
    },
    "ExpInitializer": {"first": "First value.", "rate": _RATE, "along": _ALONG},
    "NegexpInitializer": {"last": "Last value.", "rate": _RATE, "along": _ALONG},
    "LinInitializer": {"first": "First value.", "last": "Last value.", "along": _ALONG},
    "NormalInitializer": {"mean": "Mean of the distribution.", "std": "Its standard deviation."},
    "UniformInitializer": {"min": "Lowest number.", "max": "Highest number."},
    "Fir": {
        "window": "How far into the past it reaches, in samples or as a duration.",
        "out": _OUT,
        "bias": _GIVEN_BIAS,
        "weight": _WEIGHT,
        "init": _INIT,
        "dropout": _DROPOUT,
    },
    "Linear": {
        "out": _OUT,
        "bias": _GIVEN_BIAS,
        "weight": _WEIGHT,
        "init": _INIT,
        "dropout": _DROPOUT,
    },
    "Fuzzify": {
        "centers": "Centres of the fuzzy sets, ascending.",
        "membership": "Shape of the sets, or `{function: NAME}`.",
        "dim": "Dimension that numbers the sets.",
        "learn": "Whether training moves the centres.",
        "over": "Other fuzzify layers, of which this one is the grid.",
        "combine": "How the degrees of a grid are combined.",
    },
    "Mlp": {
        "hidden": "Sizes of the hidden layers.",
        "activation": "Function between the layers.",
        "out": _OUT,
        "bias": _BIAS,
        "init": _INIT,
        "dropout": _DROPOUT,
    },
    "EquationLearner": {
        "functions": "Functions of which a weighted sum is learned.",
        "mix": "Whether each function gets a learned combination of the elements.",
        "out": _OUT,
        "bias": _BIAS,
        "init": _INIT,
    },
    "Interpolation": {
        "x": "Knots, ascending.",
        "x2": "Knots of the second axis of a grid.",
        "y": "Values on the knots.",
        "unit": _UNIT,
        "learn": "Whether training changes the values.",
        "outside": "What it does beyond the knots.",
    },
    "Normalize": {
        "mean": "What is subtracted, or `data`.",
        "std": "What it is divided by, or `data`.",
        "of": "Signal whose training rows `data` means; by default the argument.",
        "unit": _UNIT,
    },
    "Iir": {
        "num": "Order of the numerator.",
        "den": "Order of the denominator.",
        "init": "Value of the filter before the first sample.",
        "fit": _FIT,
    },
    "SavitzkyGolay": {
        "window": "How far into the past it reaches, in samples or as a duration.",
        "order": "Degree of the fitted polynomial.",
        "derivative": "Which derivative with respect to time; 0 smooths.",
        "lag": "How long before t the polynomial is evaluated.",
    },
    "StateSpace": {
        "order": "Elements of its state vector.",
        "out": _OUT,
        "feedthrough": "Whether the argument reaches the result in the same step.",
        "radius": "Largest magnitude of its poles.",
        "init": "Its state before the first sample.",
        "fit": _FIT,
    },
    "LocalModel": {
        "by": "Degrees of membership that weigh the cells.",
        "cell": "The layer of each cell.",
    },
    "Function": {"args": "Names of the arguments.", "expr": "The formula.", "doc": _DOC},
    "State": {
        "unit": _UNIT,
        "dims": _DIMS,
        "der": "Derivative with respect to time.",
        "next": "Value at t+1.",
        "init": "Value before the first step, from the log: `x.meas`.",
        "history": "Values before the start, where windows reach back that far.",
        "range": "Lowest and highest value that is plausible, numbers in its unit or with one.",
        "on_range": "What becomes of a next value outside `range`: a report, its end, or `init`.",
    },
    "Equation": {
        "expr": "The expression.",
        "unit": _UNIT,
        "history": "Values before the start, where windows reach back that far.",
        "range": "Lowest and highest value that is plausible, numbers in its unit or with one.",
    },
    "Output": {
        "expr": "The expression.",
        "predicts": "Logged sample that it stands for, `x[t+1]`: loss, metric and feedback.",
        "unit": _UNIT,
        "history": "Values before the start, where windows reach back that far.",
    },
    "Loss": {"expr": "A loss such as `mse(a, b)`.", "weight": "Its weight in the total."},
    "Layout": {
        "from": "First row (from 0) or time that is used.",
        "to": "Last row or time that is used.",
        "every": "Use one row in so many.",
        "columns": "Signal on the left, column on the right; by default they have one name.",
        "time": "Column of the times.",
        "csv": "How the text files are laid out.",
        "resample": "What becomes of rows that are not one sample time apart.",
        "join": "Whether files that follow each other in time are one record.",
        "filter": "Rows that are kept: those for which a comparison of signals holds.",
    },
    "Data": {
        "source": "Files of each set: globs, relative to the spec.",
        "split": "How records are divided into train, val and test.",
        "nan": "What becomes of records with missing inputs.",
    },
    "Source": {"files": "Globs or names, relative to the spec."},
    "Column": {
        "column": "Name or index of the column, a list of them, or a pattern `tau{1..6}`.",
        "unit": "Unit of the column, converted to that of the signal.",
        "scale": "Factor of the cells.",
        "offset": "Added after the factor.",
    },
    "TimeColumn": {"column": "Name or index of the column.", "unit": "Unit of time; s by default."},
    "Csv": {
        "delimiter": "Character between cells; a comma, or a tab in .tsv files.",
        "decimal": "Decimal point or comma.",
        "comment": "Lines that start with it are passed over.",
        "header": "Whether the first line names the columns.",
        "skip": "Lines before the header.",
    },
    "Split": {
        "by": "What is divided: files, blocks of rows, each record in time, or folds.",
        "train": "Fraction, or numbers of blocks; by default what the others leave.",
        "val": "Fraction, or numbers of blocks: they decide which weights are best.",
        "test": "Fraction, or numbers of blocks: they are only measured on.",
        "blocks": "How many blocks a record is cut into.",
        "k": "How many folds are made.",
        "fold": "Number of the fold that is val, from 1.",
    },
    "Check": {
        "of": "Output or loss.",
        "metric": "How the deviation becomes a number.",
        "target": "Logged sample it is compared with; by default that of `predicts`.",
        "rollout": "How far predictions are fed back; one step by default.",
        "data": "Set of the data; `test` by default.",
        "files": "Other files to measure on, in place of a set of the data.",
        "max": "Limit that the metric must not exceed.",
        "min": "Limit that the metric must reach.",
    },
    "TargetEntry": {
        "outputs": "Outputs that are kept, or equations; by default all outputs.",
        "close": "Inputs that are fed back inside; none by default.",
    },
    "FloatTargetEntry": {"dtype": "Type of the numbers."},
    "CasadiExport": {"prefix": _PREFIX},
    "CExport": {
        "prefix": _PREFIX,
        "dtype": "Type of the numbers; `q15` and `q31` are integers.",
        "params": "Parameters as constants, through a pointer, or written into the code.",
        "math": "Own math functions, or those of the C library.",
        "ring": "How windows move.",
        "unroll": "Loops of up to so many passes are written out.",
        "constant_time": "Every step takes the same instructions, whatever its numbers are.",
        "with": "What is generated beside the step: its slopes in states, inputs and parameters.",
    },
    "Export": {
        "torch": "A module that needs only torch.",
        "onnx": "An ONNX model with explicit states.",
        "casadi": "A CasADi function.",
        "c": "C99 sources.",
    },
}


def key_doc(entry: type[Entry], key: str) -> str:
    """The line about a key of an entry, "" where there is none.

    Bases speak for what they bring; a key whose value is a mapping is explained by that, unless
    there is more to say.
    """
    for kind in entry.__mro__:
        if key in (found := _DOCS.get(kind.__name__, {})):
            return found[key]
    if key in _EVERYWHERE:
        return _EVERYWHERE[key]
    fields = ((field.alias or name, field) for name, field in entry.model_fields.items())
    (annotation,) = (field.annotation for name, field in fields if name == key)
    return about(kinds[0]) if (kinds := kinds_of(annotation)) else ""
