"""Files in and out: units, tables, limits on what is read, outputs that are whole or absent."""
