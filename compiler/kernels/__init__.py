"""The project's own scalar functions: the same bits from numpy and from the generated C.

`table.KERNELS` lists them, `evaluate` computes one on numpy arrays, `evaluate.routine` gives the
statements that numpy and the C of `backends/c_kernels` follow. They are built from + − × ÷ √,
comparisons, selections, conversions and small tables, each exact or correctly rounded.
"""
