"""Trajectory optimisation: minimise any function of a motion under limits.

Nothing here knows what an experiment is: the criterion is a function that is handed in.
"""
