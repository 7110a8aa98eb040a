"""The physical description of a drive in SI, and its one crossing to pure numbers."""
