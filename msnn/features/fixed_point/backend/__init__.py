"""C in fixed point: an integer program printed as C99 without floats, divisions or a library."""

from msnn.features.fixed_point.backend.write_fixed_c import FixedExport, write_fixed_c

__all__ = ["FixedExport", "write_fixed_c"]
