"""Writes a program as an ONNX model, built from the IR."""
