"""Optimizers: those over all starts at once, and those of other libraries."""
