"""CasADi functions of optimal control problems, for its solvers."""
