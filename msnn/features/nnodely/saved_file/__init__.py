"""Reads the file that nnodely wrote: its JSON, its grammar, its graph of relations."""
