"""What each command does, from a file to its report: the JSON document, the tables, the files."""
