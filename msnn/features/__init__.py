"""Capabilities of msnn around its core, one folder each; none imports another."""
