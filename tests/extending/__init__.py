"""Plug-ins: packages of strangers that bring sections, targets, layers and more."""
