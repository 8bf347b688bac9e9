"""Writes the functions of exported C: step, init, reset, linearize, access to the state."""
