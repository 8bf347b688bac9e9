"""Holds the verbs as Python functions: what `import msnn` offers."""
