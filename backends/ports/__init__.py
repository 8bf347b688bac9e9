"""Describes the ports of a step, as every backend shows them."""
