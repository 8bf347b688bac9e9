"""Finds the weights that training begins with."""
