"""E1030-E1069, E1132-E1134: the command line, its settings, and what a command must have."""

from collections.abc import Sequence

from compiler.ir.program import Parameter
from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.suggest import did_you_mean

_MOST_SAID = 4
"""Lines of a compiler: the first mistake of a source is followed by others that come of it."""


def refused_by_system(path: str, reason: str) -> Diagnostic:
    """E1033: a file or folder that the operating system does not let msnn read or write."""
    return error("E1033", None, f"cannot use {path or 'a file'}: {reason}")


def no_program_name(path: str, meant: str) -> Diagnostic:
    """E1045: a program file whose name does not end with `.program.json`."""
    message = f"a program file ends in `.program.json`, and {path} does not"
    return error("E1045", None, message, help=f"write `--out {meant}`, or name the folder alone")


def folder_exists(path: str) -> Diagnostic:
    """E1034: a folder for `msnn init` that exists already."""
    message = f"{path} is there already, and nothing is overwritten"
    return error("E1034", None, message, help="choose another name")


def foreign_file(path: str) -> Diagnostic:
    """E1054: a file of other origin that an export would overwrite."""
    message = f"{path} is there already and was not written by msnn"
    repair = "move it away, or write to another place with `--out`"
    return error("E1054", None, message, help=repair)


def too_large_for_float32(parameter: Parameter, value: float, target: str) -> Diagnostic:
    """E1134: a weight that is infinite in the single precision of an export."""
    message = f"`{parameter.name}` is {value:g}, which is infinite in the float32 of {target}"
    repair = f"write `dtype: float64` at `{target}:` of `export:`, or train with `max:` and `min:`"
    return error("E1134", parameter.span, message, "beyond 3.4e38", help=repair)


def unusable_name(name: str, reason: str) -> Diagnostic:
    """E1035: a project name that a spec cannot have."""
    repair = "a name has letters, digits and `_`, begins with a letter and is no reserved word"
    return error("E1035", None, f"`{name}` cannot name a model: {reason}", help=repair)


def not_trained(path: str, name: str, begun: str | None = None) -> Diagnostic:
    """E1036: a command that needs weights where none were trained."""
    repair = (
        "run `msnn train` first, or take the initial values with `--initial`"
        if begun is None
        else f"a training in {begun} has not ended: `msnn train SPEC --resume` goes on with it; "
        "this folder in place of the spec takes its best weights so far"
    )
    return error("E1036", None, f"`{name}` has no trained weights: there is no {path}", help=repair)


def missing_extra(what: str, install: str, reason: str = "") -> Diagnostic:
    """E1037: an optional package that is not installed, or that does not work."""
    state = f"does not work: {reason}" if reason else "is not installed"
    return error("E1037", None, f"{what} {state}", help=install)


def compiler_failed(compiler: str, said: Sequence[str], remedy: str) -> Diagnostic:
    """E1132: a C compiler that is installed but cannot build an export."""
    message = f"`{compiler}` did not build the export: {said[0]}"
    more = len(said) - _MOST_SAID
    notes = (*said[1:_MOST_SAID], *((f"{more} more lines",) if more > 0 else ()))
    return error("E1132", None, message, notes=notes, help=remedy)


def not_run_here(target: str, reason: str) -> Diagnostic:
    """E1133: an export that the packages installed here cannot run."""
    message = f"the {target} export was written and not compared: {reason}"
    help = f"compare it where it runs, or name other targets: `--to` without `{target}`"
    return error("E1133", None, message, help=help)


def target_differs(target: str, dtype: str, of: str, difference: str) -> Diagnostic:
    """E1057: an export whose results differ from those of the reference interpreter."""
    help = "please report it with the spec and `msnn doctor`"
    if dtype == "float32":
        help += f"; `--set export.{target}.dtype=float64` computes in double precision"
    message = f"{target} differs from the interpreter in {of}: {difference}"
    return error("E1057", None, message, help=help)


def costly_rounding(target: str, of: str, error: float) -> Diagnostic:
    """W1058: a value that single precision, in any implementation, gets wrong by more than 1e-5."""
    note = (
        "the interpreter in float32 is as far from float64: rounding is magnified there, as "
        "by a difference of near numbers or a division by a short sample time"
    )
    message = f"{of} of {target} is off by {error:.1e} of its largest magnitude in single precision"
    repair = (
        f"write `dtype: float64` at `{target}:` of `export:`, or "
        f"`--set export.{target}.dtype=float64`"
    )
    return warning("W1058", None, message, notes=(note,), help=repair)


def unknown_target(name: str, known: Sequence[str]) -> Diagnostic:
    """E1038: an export target that this version does not have."""
    message = f"`{name}` is not an export target"
    return error("E1038", None, message, help=f"the targets are {', '.join(known)} and all")


def no_data_section(command: str) -> Diagnostic:
    """E1039: a command that needs data where the spec names none."""
    message = f"the spec has no `data:` section, which {command} needs"
    return error("E1039", None, message, help="the least is `data: {source: {train: data/*.csv}}`")


def foreign_spec(name: str) -> Diagnostic:
    """E1040: a program file whose program was not compiled from the spec in it."""
    message = f"{name} does not hold the spec that its program was compiled from"
    return error("E1040", None, message, help="write it again with `msnn compile`")


def unknown_code(code: str, meant: str | None) -> Diagnostic:
    """E1041: an unknown code after `msnn explain`."""
    repair = did_you_mean(meant) or "`msnn explain` alone lists all codes"
    return error("E1041", None, f"`{code}` is not a diagnostic code", help=repair)


def not_exported_c(folder: str, target: str, damaged: str | None = None) -> Diagnostic:
    """E1046: `msnn verify` of a folder that holds no C export of this version."""
    # `damaged` is the description that it has of one, `target` what exports such
    message = f"{folder} holds no C that this version of msnn exported"
    if damaged is not None:
        message += f": `{damaged}` is missing, damaged or of another version"
    named = f"then name the folder `build/export/{target}`"
    repair = f"export it again: `msnn export SPEC --to {target}`, {named}"
    return error("E1046", None, message, help=repair)
