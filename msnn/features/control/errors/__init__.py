"""Messages about predictive control and estimation."""
