"""Provides the commands as Python functions: the public interface of `import msnn`."""
