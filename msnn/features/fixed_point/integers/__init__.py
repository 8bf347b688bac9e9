"""Programs of integers: building, running, and dropping what nothing uses."""
