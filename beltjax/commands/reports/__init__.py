"""The work of each command: it turns a file into a report with document, tables and files."""
