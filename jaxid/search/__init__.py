"""Trajectory optimisation: minimise any function of a motion under limits.

The criterion is an argument; no module here depends on what it computes.
"""
