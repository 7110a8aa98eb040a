"""Pictures of drives, of curves and of contact."""
