"""Benchmarks: they print figures and ratios measured in one run; nothing asserts a time."""
