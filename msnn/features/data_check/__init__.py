"""Looks at measured data before a model does: what is wrong with it, and what it can teach."""
