"""Reads nnodely's file: its JSON, its grammar, its graph of relations."""
