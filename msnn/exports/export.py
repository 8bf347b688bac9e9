"""Plans and writes the exports of a model, with the same code for all targets."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import numpy as np

from compiler.ir.program import UsedPlugin, with_plugins
from msnn.agreement.judgement import Loaded
from msnn.errors import commands
from msnn.errors.commands import foreign_file
from msnn.errors.failures import NotRunHereError
from msnn.exports.table import NAMES, ListedTarget, listed, names_for
from msnn.exports.target import AnyPlan, AnyTarget, Request, Weights, Written
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.plugins import plugins_with
from spec_schema.sections.exports import Export, TargetEntry
from spec_schema.version import __version__


def target_named(name: str) -> AnyTarget:
    """The target with this name, imported from its module."""
    target: AnyTarget = listed(name).load()
    return target


def target_names(
    names: Sequence[str], export: Export | None, *, sections: Collection[str] = ()
) -> tuple[str, ...]:
    """The targets named on a command line; by default those of the spec, else all suitable ones.

    `all` are the targets of msnn, and those of plug-ins that the command line or the spec names.
    `sections` are those of the spec. A target is suitable if it needs no section, or the spec has
    one that it needs: controllers need `mpc` or `estimator`. Raises SpecError if `names` has an
    unknown or an unsuitable target.
    """
    known = names_for(names)
    faults = [commands.unknown_target(n, known) for n in names if n not in (*known, "all")]
    every = tuple(name for name in NAMES if listed(name).suits(sections))
    for name in names:
        if name in known and not listed(name).suits(sections):
            refuse = target_named(name).without_section
            assert refuse is not None, f"the target {name} does not say which section it needs"
            faults.append(refuse())
    if faults:
        raise SpecError(faults)
    if "all" in names:
        others = {*names, *(() if export is None else export.asked)} - {"all"}
        return (*every, *(n for n in names_for(others) if n in others and n not in NAMES))
    return _asked(names, export) or every


def _asked(names: Sequence[str], export: Export | None) -> tuple[str, ...]:
    """The targets named on the command line or in the spec; empty for all."""
    if "all" in names:
        return ()
    asked = names or (() if export is None else export.asked)
    return tuple(name for name in names_for(asked) if name in asked)


def writable_targets(
    names: Sequence[str], export: Export | None, *, sections: Collection[str] = ()
) -> tuple[tuple[str, ...], tuple[ListedTarget, ...]]:
    """The targets to write, and the omitted ones whose packages are not installed.

    A target named on the command line or in the spec is not omitted: MissingExtraError. Raises
    SpecError for an unknown target.
    """
    targets = [listed(name) for name in target_names(names, export, sections=sections)]
    for name in _asked(names, export):
        listed(name).require_writer()
    return (
        tuple(target.name for target in targets if target.can_be_written),
        tuple(target for target in targets if not target.can_be_written),
    )


def plan_exports(
    model: Model,
    targets: Sequence[str],
    findings: Findings,
    extras: Collection[str] = (),
    weights: Weights | None = None,
) -> list[AnyPlan]:
    """Plans the export to each target; errors in its entry go to `findings`.

    `extras` are added to those of the spec, for targets that support them. If the `weights` are
    known, slices that a penalty set to 0 are omitted.
    """
    plans: list[AnyPlan] = []
    for target in map(target_named, targets):
        # `--with` names extras of any target; each takes its own
        own = [extra for extra in extras if extra in listed(target.name).extras]
        request = Request(model, findings, own, weights)
        plan = target.prepare(request, _entry(model.spec.export, target))
        if plan is not None:
            plans.append(replace(plan, cuts=tuple(request.cuts)))
    return plans


def _entry(export: Export | None, target: AnyTarget) -> TargetEntry | None:
    return None if export is None else export.entry(target.entry)


def write_export(plan: AnyPlan, weights: Weights, folder: Path) -> Written:
    """Writes the files of one target into the folder.

    They are written atomically: an interrupted command leaves the old files. Raises SpecError
    (E1054) if files of other origin would be replaced, and E1134 for weights outside the range of
    the dtype.
    """
    from backends.files.atomic_write import replacing_files  # `check` plans exports without it

    own = plan.of(weights)
    if plan.dtype == "float32":
        _refuse_infinite(plan, own)
    with replacing_files(folder) as temporary:
        files = plan.target.write(plan, own, temporary)
        files = tuple(dict.fromkeys((*files, *_manifest_with_plugins(plan, files, temporary))))
        spare_foreign_files(folder / path.relative_to(temporary) for path in files)
    # files were written elsewhere and have moved: told by where they are now
    return Written(folder, tuple(folder / path.relative_to(temporary) for path in files))


def _manifest_with_plugins(plan: AnyPlan, files: Sequence[Path], folder: Path) -> tuple[Path, ...]:
    """The manifest with a comment that names the plug-ins of the spec and of the target.

    A target of a plug-in gets a manifest by this; one of ours has it if it writes one.
    """
    of_target = plugins_with([("target", plan.target.name)])
    used = {UsedPlugin(plugin.package, plugin.version) for plugin in of_target}
    used |= {*plan.program.plugins}
    if not used:
        return ()
    from backends.files.atomic_write import write_text
    from backends.files.export_identity import MANIFEST, manifest_text

    manifest = folder / MANIFEST
    if of_target:
        listed = [path for path in files if path != manifest]
        contents = {path.relative_to(folder).as_posix(): path.read_bytes() for path in listed}
        text = manifest_text(contents)
    elif manifest in files:
        text = manifest.read_text(encoding="utf-8")
    else:
        return ()
    named = with_plugins(sorted(used, key=lambda plugin: plugin.package))
    return (write_text(manifest, f"# made by msnn {__version__}{named}\n{text}"),)


def _refuse_infinite(plan: AnyPlan, weights: Weights) -> None:
    """Raises SpecError (E1134) for weights whose nearest float32 is infinite."""
    faults: list[Diagnostic] = []
    for parameter in plan.program.parameters:
        values = np.ravel(weights.get(parameter.name, ()))
        with np.errstate(over="ignore"):
            lost = values[np.isinf(values.astype(np.float32))]
        if len(lost):
            value = float(lost[0])
            faults.append(commands.too_large_for_float32(parameter, value, plan.target.name))
    if faults:
        raise SpecError(tuple(faults))


def load_export(plan: AnyPlan, written: Written) -> AbstractContextManager[Loaded]:
    """Loads the written files, to run them.

    Raises MissingExtraError if a required package or tool is not installed.
    """
    name = plan.target.name
    listed(name).require_runner()
    if plan.target.load is None:
        raise NotRunHereError(name, "nothing here runs what it writes")
    return plan.target.load(plan, written)


_READ = 1 << 20
"""Number of bytes of a file that are searched for the sign."""
_SIGN = b"msnn"
"""A text in comments and descriptions of msnn; at least one file of each export contains it."""


def spare_foreign_files(places: Iterable[Path], sign: bytes = _SIGN) -> None:
    """Raises SpecError (E1054) if these files exist and none of them contains the sign.

    An existing export is replaced as a whole, including manual changes.
    """
    there = [path for path in places if path.is_file()]
    if there and not any(sign in _beginning(path) for path in there):
        raise SpecError([foreign_file(str(there[0]))])


def _beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_READ)
