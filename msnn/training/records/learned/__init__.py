"""Describes the learned parameters: values, standard errors, zeros."""
