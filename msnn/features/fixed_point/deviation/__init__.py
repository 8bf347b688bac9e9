"""Differences between steps in integers and the same steps in real numbers."""
