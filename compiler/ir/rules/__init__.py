"""Says which programs are legal: types, units and alignment of every operation."""
