"""The numbers of the kernels: formats and coefficients."""
