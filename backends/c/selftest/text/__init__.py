"""Writes self-tests and golden vectors as C."""
