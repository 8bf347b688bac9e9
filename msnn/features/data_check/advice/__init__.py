"""Turns what data show into sentences, with what to write in the spec."""
