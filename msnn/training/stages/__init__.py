"""Runs stages of a training: their starts, epochs and best weights."""
