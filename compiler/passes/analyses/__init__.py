"""Finds what passes and backends may rely on; changes nothing."""
