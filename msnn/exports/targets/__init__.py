"""The targets of exports, one a file; `exports/table` lists them."""
