"""Shows models and runs: text, tables, graphs, formulas, plots."""
