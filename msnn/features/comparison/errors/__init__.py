"""Messages about comparisons and sweeps."""
