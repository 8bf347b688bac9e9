"""Runs rollouts in kernels without learning: outputs, sums of losses, sensitivities."""
