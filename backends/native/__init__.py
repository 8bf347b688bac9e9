"""Training kernels in C: the step, its reverse and rollout loops, one rollout per SIMD lane."""
