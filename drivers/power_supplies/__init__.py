"""Power supplies of the DUTs."""
