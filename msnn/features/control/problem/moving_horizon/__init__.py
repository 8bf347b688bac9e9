"""States moving-horizon estimation as an optimal control problem."""
