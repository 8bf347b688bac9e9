"""Trains the parameters of a program on measured data, stage after stage."""
