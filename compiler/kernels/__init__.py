"""The project's own scalar functions: the same bits from numpy and from the generated C.

`KERNELS` lists them, `evaluate` computes one on numpy arrays, `c_sources` writes the C of those
that a model uses, `routine` gives the statements that both follow. They are built from
+ − × ÷ √, comparisons, selections, conversions and small tables, each exact or correctly rounded.
"""

from compiler.kernels.c_sources import CKernels, c_sources
from compiler.kernels.evaluate import evaluate, routine
from compiler.kernels.table import KERNELS, Kernel

__all__ = ["KERNELS", "CKernels", "Kernel", "c_sources", "evaluate", "routine"]
