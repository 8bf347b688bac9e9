"""Searches single steps that show in generated C what plain golden steps do not."""
