"""Describes the ports of an exported step: names, axes, units and samples, the same in all
backends.
"""
