"""Random well-typed specs over the whole language, through every backend."""
