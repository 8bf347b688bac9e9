"""Derives graphs that compute derivatives, in reverse mode (gradients) and forward mode
(tangents).
"""
