"""Trains in several processes that share the batches of one training."""
