"""Lowers losses: what is compared with what, and how it becomes a number."""
