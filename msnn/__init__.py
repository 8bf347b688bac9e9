"""The tool people touch: specs to trained, validated and exported models."""
