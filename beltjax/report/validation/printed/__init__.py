"""What the dissertation prints in its tables, captions and figures; its inputs where they are used."""
