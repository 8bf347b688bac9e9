"""Recognises groups of relations that correspond to one construct of the language."""
