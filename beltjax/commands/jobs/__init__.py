"""What each command does, from a file to its report."""
