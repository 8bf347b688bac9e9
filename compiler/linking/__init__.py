"""Sub-models: a spec and those that it uses become one spec of full names."""
