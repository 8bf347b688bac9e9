"""The problems of control and estimation as data, and the mathematics on them."""
