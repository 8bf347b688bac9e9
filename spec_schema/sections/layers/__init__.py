"""The layers that a spec can declare, and their options."""
