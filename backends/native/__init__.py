"""Training kernels: the step, its reverse and the rollout loops as C with samples in SIMD lanes."""
