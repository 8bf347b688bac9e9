"""Traces a routine into statements, and evaluates or simplifies them."""
