"""What people ask of a drive."""
