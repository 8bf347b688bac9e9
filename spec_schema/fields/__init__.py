"""The leaves and frames of which the sections of a spec are made."""
