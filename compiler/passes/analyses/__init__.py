"""Analyses of programs for passes and backends; they change nothing."""
