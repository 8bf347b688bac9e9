"""Records what was learned: parameters, how sure they are, what is 0."""
