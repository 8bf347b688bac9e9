"""Reads measured data: files become records, records become episodes, episodes give starts."""
