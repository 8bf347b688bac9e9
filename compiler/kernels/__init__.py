"""Scalar functions of msnn itself, with the same bits from numpy and from the generated C.

`table.KERNELS` lists them, `evaluate` computes one on numpy arrays, and `evaluate.routine` returns
the statements that both numpy and the C of `backends/c_kernels` follow. They consist of + − × ÷ √,
comparisons, selections, conversions and small tables, each exact or correctly rounded.
"""
