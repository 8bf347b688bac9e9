"""Computes losses and gradients: by native kernels or by torch."""
