"""Dimensionless models, one file each, in the letters of the source."""
