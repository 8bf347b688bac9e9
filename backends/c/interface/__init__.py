"""Describes what a user of exported C sees: structs, status bits, metadata."""
