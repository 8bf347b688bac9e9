"""Describes the information that programs pass to training, and training to its graphs."""
