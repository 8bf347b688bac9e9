"""Runs the stages of a training: initial states, epochs and best weights."""
