"""Optimizers: the augmented Lagrangian over all starts at once, and those of other libraries."""
