"""Motions: piecewise-constant jerk, limits, and the linear conditions for keeping them."""
