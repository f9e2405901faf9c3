"""Every model on the same data and the same splits: one table and one figure (fogbench compare)."""
