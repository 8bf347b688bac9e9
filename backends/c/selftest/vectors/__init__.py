"""Makes golden vectors, and judges in numpy what their steps answer."""
