"""Scalar functions: the table of them, their formulas, slopes and signatures."""
