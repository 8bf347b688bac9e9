"""Reads tables of text: CSV, and workbooks as the text that they would be saved as."""
