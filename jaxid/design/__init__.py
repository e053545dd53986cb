"""Optimal experiment design: criteria of a motion, and the motion that minimises them."""
