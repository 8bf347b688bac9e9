"""Formats findings about data as messages with a change of the spec."""
