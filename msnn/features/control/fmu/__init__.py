"""Makes units of controllers and filters."""
