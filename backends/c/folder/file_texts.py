"""Makes the texts of all files of a folder with generated C, which builds by itself."""

from __future__ import annotations

import re
import zlib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from backends.asap2.text import a2l_text
from backends.c.folder.calibrated_model import calibrated_model
from backends.c.folder.header_text import about_text, header_text
from backends.c.folder.ros2_texts import ros2_texts
from backends.c.functions.function_writer import ControllerCode, Weights
from backends.c.functions.input_policy import nearest_to_zero, policy_functions
from backends.c.functions.linearize import linearize_function
from backends.c.functions.start import init_function, reset_function, restart_functions
from backends.c.functions.state_vector import vector_functions
from backends.c.functions.step import step_function
from backends.c.interface.interface import Field, Interface, c_interface
from backends.c.interface.layout_metadata import layout_metadata
from backends.c.selftest.selftest_text import SELFTEST_STEPS, selftest_text, test_texts
from backends.c_kernels.sources import c_sources
from backends.c_language.functions import FunctionNames, FunctionTable
from backends.c_language.literals import Dtype, real_literal
from backends.c_language.printer import Printer
from backends.c_language.rendering import Generated, comment_text, render
from backends.c_language.tree import Function
from backends.c_lowering.options import COptions
from backends.files.atomic_write import write_text
from backends.files.export_identity import with_identity, with_manifest
from backends.ports.metadata import metadata_text
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from spec_schema.version import __version__


def file_texts(program: Program, interface: Interface, weights: Weights) -> dict[str, str]:
    """All files of an exported folder: path in the folder → text. The same program, interface and
    weights (physical arrays by name) give the same texts.
    """
    files = library_texts(program, interface, weights)
    files |= {
        **test_texts(program, interface, weights),
        f"{interface.prefix}.a2l": a2l_text(calibrated_model(program, interface)),
    }
    if interface.options.ros2:
        files |= ros2_texts(program, interface, files)
    # packages list all sources
    files |= package_texts(interface, files)
    files["README.md"] = _readme(interface, files)
    return with_manifest(with_identity(dict(sorted(files.items()))))


def library_texts(program: Program, interface: Interface, weights: Weights) -> dict[str, str]:
    """All sources that an export compiles, path in the folder → text: header, sources, JSON
    description, FFI and self-test. `weights` are physical arrays by name.
    """
    files, kernels = _model_texts(program, interface, weights)
    files[f"src/{interface.prefix}_selftest.c"] = selftest_text(
        program, interface, weights, kernels
    )
    return files


def model_texts(program: Program, interface: Interface, weights: Weights) -> dict[str, str]:
    """The files that a calling program needs, path in the folder → text: header, sources, JSON
    description, and the Python and C files of the FFI. `weights` are physical arrays by name.
    """
    return _model_texts(program, interface, weights)[0]


def _model_texts(
    program: Program, interface: Interface, weights: Weights
) -> tuple[dict[str, str], Collection[str]]:
    """The texts of `model_texts`, path in the folder → text, and the names of the math kernels that
    the code calls.
    """
    prefix, options = interface.prefix, interface.options
    # one table for all functions: shared helpers are defined once, in the order of first use
    table = FunctionTable(FunctionNames(prefix, options.dtype, options.math, options.constant_time))
    model = ControllerCode(interface, weights, table, program.formulas)
    every = program.sample_time
    sample_time = None if every is None else real_literal(every, options.dtype)
    functions = {
        "init": init_function(program, model),
        "reset": reset_function(program, model),
        "step": step_function(program, model),
    }
    vectors: list[Function] = []
    restarts = restart_functions(program, model)
    title = "Step, init and reset"
    if interface.jacobian is not None:
        functions["linearize"] = linearize_function(model, interface.jacobian)
        vectors = vector_functions(interface, interface.jacobian)
        title = "Step, init, reset and Jacobian"
    files = {
        f"include/{prefix}.h": header_text(
            program,
            interface,
            functions,
            vectors,
            selftest_steps=SELFTEST_STEPS,
            kernels=bool(table.kernels),
        ),
        f"src/{prefix}_about.c": about_text(interface, program, sample_time),
        f"src/{prefix}.c": _source(
            interface, table, title, [*restarts, *functions.values(), *vectors]
        ),
        f"{prefix}.json": metadata_text(layout_metadata(program, interface, weights)),
    }
    if interface.takes_parameters:
        files[f"src/{prefix}_params.c"] = parameters_text(interface, weights)
    if interface.calibrates:
        files[f"src/{prefix}_calibration.c"] = calibration_text(interface, weights)
    # lowering the functions has filled the table
    if table.kernels:
        real = "float" if options.dtype == "float32" else "double"
        kernels = c_sources(table.kernels, real, prefix, constant_time=options.constant_time)
        files[f"src/{kernels.header_name}"] = kernels.header
        files[f"src/{kernels.source_name}"] = kernels.source
    real = "c_float" if options.dtype == "float32" else "c_double"
    files |= ffi_texts(interface, {"real": real}, linearizes=interface.jacobian is not None)
    return files, table.kernels


def _source(
    interface: Interface, table: FunctionTable, title: str, functions: list[Function]
) -> str:
    printer = Printer(interface.prefix, interface.options.dtype, places_tables=True)
    checks = policy_functions(interface, table)
    all_functions = [*table.definitions(), *checks, *functions]
    return render(
        "source.c.j2",
        interface,
        title,
        kernels=bool(table.kernels),
        functions=[printer.function(function) for function in all_functions],
    )


def _readme(interface: Interface, files: dict[str, str]) -> str:
    dtype = interface.options.dtype
    # windows and supplied states are in the same struct of `reset`, so they share a table of ranges
    signals = {port.signal.name: port.signal.range for _, port in interface.windows}
    signals |= {state.name: state.range for _, state in interface.supplied}
    starts = [field for field, _ in interface.windows] + [f for f, _ in interface.supplied]
    return render(
        "README.md.j2",
        interface,
        "",
        dtype=dtype,
        exact=interface.options.is_exact,
        version=NUMBER,
        parameter_bytes=sum(field.size for field in interface.parameters)
        * (4 if dtype == "float32" else 8),
        sources=sorted(name for name in files if name.startswith("src/") and name.endswith(".c")),
        headers=[f"{interface.prefix}.h"],
        in_reals=True,
        input_names=[input.field.name for input in interface.inputs],
        assignments=[
            _assignment("u", i.field, i.port.signal.range, dtype) for i in interface.inputs
        ],
        starts=[_assignment("x0", field, signals[field.name], dtype) for field in starts],
        outputs=[f"(double){_shown(field)}" for field in interface.outputs],
        tunable=interface.options.moves_parameters,
        calibrates=interface.calibrates,
        section=interface.calibration_section,
        waits_for_reset=bool(interface.from_record),
        late=interface.late,
        constant_time=interface.options.constant_time,
        ros2=interface.options.ros2,
        linearizes=interface.jacobian is not None,
        of_parameters="parameter_jacobian" in interface.options.extras,
        declared_only="state_jacobian" in interface.options.extras,
        remembers=interface.jacobian is not None
        and any(vector.letter == "x" for vector in interface.jacobian.vectors),
    )


def _assignment(base: str, field: Field, limits: tuple[float, float] | None, dtype: Dtype) -> str:
    """A C statement that sets a field of the struct variable `base` to the value within `limits`
    that is nearest to 0; a loop for an array. It ends with the unit, if there is one, as a comment.
    """
    value = real_literal(nearest_to_zero(limits, dtype), dtype)
    unit = f" /* {comment_text(field.unit.text)} */" if field.unit is not None else ""
    if not field.shape:
        return f"{base}.{field.identifier} = {value};{unit}"
    return f"for (int i = 0; i < {field.size}; i++) {base}.{field.identifier}[i] = {value};{unit}"


def _shown(field: Field) -> str:
    return f"y.{field.identifier}[0]" if field.shape else f"y.{field.identifier}"


def parameters_text(interface: Interface, weights: Weights) -> str:
    """`src/<prefix>_params.c`: a constant struct with the weights (physical arrays by name)."""
    fields = _fields(interface, weights, "    ")
    return render("params.c.j2", interface, "Trained values", fields=fields)


def calibration_text(interface: Interface, weights: Weights) -> str:
    """`src/<prefix>_calibration.c`: a variable in its own linker section with the weights (physical
    arrays by name) and their checksum.
    """
    return render(
        "calibration.c.j2",
        interface,
        "Values for calibration",
        # one level deeper: the values are a struct next to their checksum
        fields=_fields(interface, weights, "        "),
        section=interface.calibration_section,
        checksum=f"0x{_checksum(interface, weights):08X}",
        count=sum(field.size for field in interface.parameters),
        word="uint32_t" if interface.options.dtype == "float32" else "uint64_t",
    )


def _checksum(interface: Interface, weights: Weights) -> int:
    """CRC-32 of the bytes of all parameters, in the order of the struct. Bytes are little-endian,
    also for big-endian processors.
    """
    order = "<f4" if interface.options.dtype == "float32" else "<f8"
    # in the order of the struct's fields; all elements have one type, so there is no padding
    numbers = [np.asarray(weights[field.name]).ravel() for field in interface.parameters]
    return zlib.crc32(np.concatenate(numbers).astype(order).tobytes())


def _fields(interface: Interface, weights: Weights, indent: str) -> list[dict[str, str]]:
    dtype = interface.options.dtype
    printer = Printer(interface.prefix, dtype)
    fields: list[dict[str, str]] = []
    for field in interface.parameters:
        numbers = [real_literal(float(value), dtype) for value in weights[field.name].ravel()]
        value = printer.braced(numbers, indent) if field.shape else numbers[0]
        fields.append({"name": comment_text(field.name), "value": value})
    return fields


NUMBER = ".".join(re.findall(r"\d+", __version__)[:3])
"""The version of msnn as digits only, for build systems."""


def package_texts(
    interface: Generated, paths: Iterable[str], *, in_reals: bool = True
) -> dict[str, str]:
    """Build files and packages, path in the folder → text: CMake, Zephyr, Arduino. `paths` are the
    other files of the folder, from which sources and headers are listed. `in_reals` is False for
    fixed-point code.
    """
    named = sorted(paths)
    facts: dict[str, Any] = {
        "sources": [path for path in named if path.startswith("src/") and path.endswith(".c")],
        "headers": [path for path in named if path.startswith("include/")],
        "in_reals": in_reals,
        # digits only: CMake and Arduino accept no suffix of a development version
        "version": NUMBER,
    }
    files = {
        "CMakeLists.txt": "CMakeLists.txt.j2",
        "zephyr/module.yml": "packages/zephyr_module.yml.j2",
        "zephyr/Kconfig": "packages/zephyr_Kconfig.j2",
        "zephyr/CMakeLists.txt": "packages/zephyr_CMakeLists.txt.j2",
        "library.properties": "packages/library.properties.j2",
    }
    texts = {path: render(template, interface, "", **facts) for path, template in files.items()}
    return texts | dict(_forward(interface, header) for header in facts["headers"])


def _forward(interface: Generated, header: str) -> tuple[str, str]:
    """Path and text of a header in `src/` that only includes `header`, a path below `include/`."""
    name = header.removeprefix("include/")
    guard = f"{name.removesuffix('.h').upper()}_FORWARD_H"
    template = "packages/forward.h.j2"
    # Arduino searches headers in `src/` only; all others use `include/`
    return f"src/{name}", render(template, interface, "Interface", header=header, guard=guard)


def ffi_texts(
    interface: Generated, numbers: Mapping[str, str], *, linearizes: bool = False
) -> dict[str, str]:
    """`<prefix>_ffi.py` and `<prefix>_ffi.c`, with which Python calls the model: path in the folder
    → text. `numbers` maps number types of the JSON file (`real`, `word`) to ctypes names
    (`c_float`). `linearizes`: the model has a Jacobian.
    """
    # the type names of the JSON file, from which the Python file builds its structs
    types = {**numbers, "uint32": "c_uint32"}
    facts: dict[str, Any] = {"types": types, "words": "word" in numbers, "jacobian": linearizes}
    return {
        f"{interface.prefix}_ffi.py": render("ffi.py.j2", interface, "", **facts),
        f"{interface.prefix}_ffi.c": render("ffi.c.j2", interface, "Many steps at once"),
    }


_DEFAULT_OPTIONS = COptions()


def write_c(
    program: Program,
    weights: Mapping[str, ArrayLike],
    folder: Path,
    options: COptions = _DEFAULT_OPTIONS,
) -> tuple[Path, ...]:
    """Writes header, sources, self-test, build file and README; returns their paths.

    `program` is in step form, its losses are left out. `weights` are physical arrays by name, a
    missing one is the parameter's initial value. The same arguments give the same bytes. Raises
    ValueError for a program in window form or weights of a wrong shape, OSError.
    """
    interface = c_interface(program, options)
    # all texts first: a model that cannot be lowered leaves no half of a folder behind
    texts = file_texts(program, interface, physical_weights(program, weights))
    return tuple(write_text(folder / name, text) for name, text in texts.items())
