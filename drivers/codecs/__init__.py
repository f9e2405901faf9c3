"""Bytes to messages and back: no I/O, no clock. Both roles, so that a simulator speaks through the same code."""
