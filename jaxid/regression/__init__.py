"""Worst-case theory of a data record: estimator weights, their worst-case errors, lower bounds."""
