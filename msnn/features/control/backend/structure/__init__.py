"""Brings a problem into the form that a solver takes, staged or condensed."""
