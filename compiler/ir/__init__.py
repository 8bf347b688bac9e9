"""The typed intermediate representation: types, operations, graphs, programs."""
