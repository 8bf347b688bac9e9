"""Gives every name of a spec its nodes: constants, calls, states, buffers."""
