"""What is said of two models and their metrics."""
