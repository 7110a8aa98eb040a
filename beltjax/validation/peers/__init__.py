"""Second routes to the same numbers, by SciPy alone: tests and benchmarks compare with them."""
