"""The fogbench command line."""
