"""Statistics of errors, from arrays only."""
