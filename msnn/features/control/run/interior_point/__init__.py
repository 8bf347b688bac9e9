"""Solves an optimal control problem by a primal-dual interior-point method."""
