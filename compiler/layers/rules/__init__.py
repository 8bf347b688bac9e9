"""Shared parts of layers: arguments, memory, arrays, initial fits."""
