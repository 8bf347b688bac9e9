"""The project's own implementations of scalar functions (math kernels). numpy and the generated C
return the same bits.

`table.KERNELS` lists them, `evaluate` computes one on numpy arrays, and `table.routine` returns the
statements that both numpy and the C of `backends/c_kernels` follow. They consist of + − × ÷ √,
comparisons, selections, conversions and small tables, each exact or correctly rounded.
"""
