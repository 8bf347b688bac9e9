"""The project's own scalar functions: the same bits from numpy and from the generated C.

`table.KERNELS` lists them, `evaluate` computes one on numpy arrays, `c_sources` writes the C
of those that a model uses, `evaluate.routine` gives the statements that both follow. They are
built from + − × ÷ √, comparisons, selections, conversions and small tables, each exact or correctly
rounded.
"""
