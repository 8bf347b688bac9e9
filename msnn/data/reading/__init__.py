"""Turns the files of a spec's data section into one dataset."""
