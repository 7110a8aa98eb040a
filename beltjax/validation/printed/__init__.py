"""What the dissertation prints in its tables, captions and figures, results and inputs."""
