"""Holds what layers share: arguments, memory, arrays, initial fits."""
