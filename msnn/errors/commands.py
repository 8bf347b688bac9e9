"""E1030-E1069: the command line, its settings, and what must be installed for a command."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic


def refused_by_system(path: str, reason: str) -> Diagnostic:
    """E1033: a file or folder that the system does not let us write or read."""
    return Diagnostic("E1033", "error", f"cannot use {path or 'a file'}: {reason}", None)


def no_program_name(path: str, meant: str) -> Diagnostic:
    """E1045: a program file under a name that tells no verb what it is."""
    return Diagnostic(
        "E1045",
        "error",
        f"a program file ends in `.program.json`, and {path} does not",
        None,
        help=f"write `--out {meant}`, or name the folder alone",
    )


def folder_exists(path: str) -> Diagnostic:
    """E1034: `msnn init` where something is already."""
    return Diagnostic(
        "E1034",
        "error",
        f"{path} is there already, and nothing is overwritten",
        None,
        help="choose another name",
    )


def unusable_name(name: str, reason: str) -> Diagnostic:
    """E1035: a project name that a spec cannot have."""
    return Diagnostic(
        "E1035",
        "error",
        f"`{name}` cannot name a model: {reason}",
        None,
        help="a name has letters, digits and `_`, begins with a letter and is no reserved word",
    )


def not_trained(path: str, name: str, begun: str | None = None) -> Diagnostic:
    """E1036: a command that needs weights where none were trained."""
    return Diagnostic(
        "E1036",
        "error",
        f"`{name}` has no trained weights: there is no {path}",
        None,
        help="run `msnn train` first, or take the initial values with `--initial`"
        if begun is None
        else f"a training in {begun} has not ended: `msnn train SPEC --resume` goes on with it; "
        "this folder in place of the spec takes its best weights so far",
    )


def missing_extra(what: str, install: str) -> Diagnostic:
    """E1037: an optional part that is not installed."""
    return Diagnostic("E1037", "error", f"{what} is not installed", None, help=install)


def target_differs(target: str, dtype: str, of: str, difference: str) -> Diagnostic:
    """E1057: an export that computes something else than the interpreter."""
    help = "please report it with the spec and `msnn doctor`"
    if dtype == "float32":
        help += f"; `--set export.{target}.dtype=float64` computes in double precision"
    return Diagnostic(
        "E1057",
        "error",
        f"{target} differs from the interpreter in {of}: {difference}",
        None,
        help=help,
    )


def costly_rounding(target: str, of: str, error: float) -> Diagnostic:
    """W1058: a value that single precision, in any implementation, gets wrong by more than 1e-5."""
    note = (
        "the interpreter in float32 is as far from float64: rounding is magnified there, as "
        "by a difference of near numbers or a division by a short sample time"
    )
    return Diagnostic(
        "W1058",
        "warning",
        f"{of} of {target} is off by {error:.1e} of its largest magnitude in single precision",
        None,
        notes=(note,),
        help=f"write `dtype: float64` at `{target}:` of `export:`, or "
        f"`--set export.{target}.dtype=float64`",
    )


def unknown_target(name: str, known: Sequence[str]) -> Diagnostic:
    """E1038: an export target that this version does not have."""
    return Diagnostic(
        "E1038",
        "error",
        f"`{name}` is not an export target",
        None,
        help=f"the targets are {', '.join(known)} and all",
    )


def no_data_section(command: str) -> Diagnostic:
    """E1039: a command that needs data where the spec names none."""
    return Diagnostic(
        "E1039",
        "error",
        f"the spec has no `data:` section, which {command} needs",
        None,
        help="the least is `data: {source: {train: data/*.csv}}`",
    )


def foreign_spec(name: str) -> Diagnostic:
    """E1040: a program file whose program was not compiled from the spec in it."""
    return Diagnostic(
        "E1040",
        "error",
        f"{name} does not hold the spec that its program was compiled from",
        None,
        help="write it again with `msnn compile`",
    )


def unknown_code(code: str, meant: str | None) -> Diagnostic:
    """E1041: `msnn explain` of something that is no code."""
    return Diagnostic(
        "E1041",
        "error",
        f"`{code}` is not a diagnostic code",
        None,
        help=f"did you mean `{meant}`?" if meant else "`msnn explain` alone lists all codes",
    )


def not_exported_c(folder: str) -> Diagnostic:
    """E1046: `msnn verify` of a folder that holds no C export of this version."""
    return Diagnostic(
        "E1046",
        "error",
        f"{folder} holds no C that this version of msnn exported",
        None,
        help="export it again: `msnn export SPEC --to c`, then name the folder `build/export/c`",
    )
