"""Writes an imported model: a compiled spec and its weights."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.files.atomic_write import write_text
from compiler.elaboration.compile import compile_spec
from compiler.ir.program import Program
from msnn.features.nnodely.errors import does_not_compile, file_exists
from msnn.features.nnodely.import_model import ImportedModel, import_text, read_text
from msnn.features.nnodely.terms.names import legal_name
from msnn.model.weights.weights_file import initial_weights, write_weights
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError, describe
from spec_schema.editors.format_spec import format_spec
from spec_schema.reading.reader import read_spec
from spec_schema.yaml_tree.writer import yaml_text

_HEAD = """\
# {name}: a model of nnodely 1.x, read from {file}.
# Its weights are in {weights}; the initial values here are those too, where they are few.
# nnodely knows no units: `unit:` of inputs and parameters lets msnn check them.

"""


@dataclass(frozen=True, slots=True)
class WrittenImport:
    """The files of an import, and notes for the user."""

    spec: Path
    weights: Path
    warnings: tuple[Diagnostic, ...]
    model: ImportedModel


def write_import(file: Path, out: Path | None) -> WrittenImport:
    """The spec and the weights of a saved model, as files."""
    read = read_text(file)
    # a folder exists; the file of that name in it is not what was said
    if out is not None and out.is_dir():
        raise SpecError([file_exists(str(out))])
    spec_file = file.with_name(f"{_stem(file)}.msnn.yaml") if out is None else out
    weights_file = spec_file.with_name(f"{_stem(spec_file)}.safetensors")
    for written in (spec_file, weights_file):
        if written.exists():
            raise SpecError([file_exists(str(written))])
    # the name of the spec becomes names of C and folders
    name = legal_name(_stem(spec_file))
    model = import_text(read, str(file), name)
    text, program = compiled(model, file.name, spec_file, weights_file.name)
    weights = {
        name: np.asarray(model.weights.get(name, value), np.float64).reshape(value.shape)
        for name, value in initial_weights(program).items()
    }
    # weights first: a spec that is there is complete
    write_weights(weights_file, weights, program)
    try:
        write_text(spec_file, text)
    except OSError:
        # weights without their spec are of no use
        weights_file.unlink(missing_ok=True)
        raise
    return WrittenImport(spec_file, weights_file, model.warnings, model)


def compiled(model: ImportedModel, file: str, path: Path, weights: str) -> tuple[str, Program]:
    """The text of the spec and its program. Raises SpecError if it does not compile."""
    try:
        # compiled as it will be read, from its text
        text = spec_text(model, file, weights)
        read = read_spec(path, text)
        return text, compile_spec(read.spec, used=read.used).program
    except SpecError as fault:
        reasons = [describe(one) for one in fault.diagnostics if one.severity == "error"]
        raise SpecError([does_not_compile("; ".join(reasons[:3]))]) from None


def spec_text(model: ImportedModel, file: str, weights: str) -> str:
    """The text of the spec."""
    sections = [yaml_text({key: value}) for key, value in model.spec.items()]
    head, rest = "".join(sections[:3]), "\n".join(sections[3:])
    # a line break in the name of a file would end the comment
    shown = "".join(c if c.isprintable() else " " for c in file)
    remark = _HEAD.format(name=model.spec["name"], file=shown, weights=weights)
    return format_spec("imported.msnn.yaml", f"{remark}{head}\n{rest}")


def _stem(path: Path) -> str:
    name = path.name
    for ending in (".json", ".yaml", ".yml", ".msnn"):
        name = name.removesuffix(ending)
    return name
