"""The data section: files, columns, splits."""
