"""Faults by name: wrong behaviours that simulated instruments can be told to show, each one counted in a truth log."""
