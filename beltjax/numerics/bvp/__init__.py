"""Two-point boundary value problems by collocation."""
