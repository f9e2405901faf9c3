"""Allan deviation of a file or of a run: reading, and the picture."""
