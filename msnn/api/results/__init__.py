"""Holds what verbs return: their results with tables, frames and pictures."""
