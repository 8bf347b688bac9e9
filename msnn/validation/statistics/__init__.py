"""Computes what errors say, from arrays alone."""
