"""A real drone arm: models of it trained and scored by the command line, beside published figures."""
