"""Keeps built kernels: in which folder, how whole ones are known, what is thrown away."""
