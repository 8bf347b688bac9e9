"""Programs of integers: construction, interpretation, and removal of unused nodes."""
