"""Suggests a repair for values whose shape does not match their entry."""

from compiler.ir.types import Axis
from compiler.lowering.context import Context
from spec_schema.sections.dimensions import Dimension


def shape_repair(
    context: Context, name: str, found: tuple[int, ...], axes: tuple[Axis, ...]
) -> str | None:
    """The suggested repair for values of another shape than the entry declares."""
    if axes:
        wanted = " x ".join(str(axis.size) for axis in axes)
        return f"write {wanted} numbers, or one number for all"
    if set(found) == {1}:
        return "write the number without brackets"
    # arrays of a layer have no entry to which `dims:` could be added
    return dims_repair(context, found) if name in context.scope else None


def dims_repair(context: Context, shape: tuple[int, ...]) -> str:
    """The `dims:` that an array of this shape needs, with the declaration of missing dimensions."""
    declared = {
        entry.name: entry.entry.size
        for entry in context.scope.values()
        if isinstance(entry.entry, Dimension)
    }
    taken: list[str] = []
    missing: list[str] = []
    for position, size in enumerate(shape, start=1):
        # the axes of one array have different names
        fitting = (name for name in declared if declared[name] == size and name not in taken)
        name = next(fitting, None)
        if name is None:
            name = "NAME" if len(shape) == 1 else f"NAME{position}"
            missing.append(f"{name}: {size}")
        taken.append(name)
    names = taken[0] if len(taken) == 1 else f"[{', '.join(taken)}]"
    repair = f"add `dims: {names}` to it"
    return f"{repair}, and `{', '.join(missing)}` to `dims:` of the spec" if missing else repair
