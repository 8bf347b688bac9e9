"""Messages about recorded data and about first specs of data."""
