"""Gyros: streams of frames over a serial line or CAN."""
