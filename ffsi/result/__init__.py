"""A finished run, read from its folder: quantities, fields, what it comes to in time, published values."""
