"""A small tree of C and its printer: syntax, layout, literals, scopes."""
