"""fogbench verify: everything of a run that can be computed again is, and compared with what is on disk."""
