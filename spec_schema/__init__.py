"""Reads what a user may write: text to Spec, each thing with its place in the file.

`reader.read_spec` gives a `spec.Spec`; what is wrong with a file comes as `diagnostics.Diagnostic`,
printed by `render.render`. Mathematics is an `expression.Expression`; units are `units.Unit`. The
modules are imported one by one, so that a command pays only for what it uses.
"""
