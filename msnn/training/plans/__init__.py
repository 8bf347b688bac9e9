"""Plans each stage before training."""
