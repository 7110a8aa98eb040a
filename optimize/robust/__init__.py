"""Tolerances: how numbers scatter, and what that makes of what a drive does."""
