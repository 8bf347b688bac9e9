"""Describes the public interface of exported C: structs, status bits, metadata."""
