"""Searches single steps that detect errors of generated C which plain golden steps miss."""
