"""The floating-point formats of the math kernels, and their coefficients."""
