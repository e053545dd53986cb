"""Worst-case theory of a data record: estimators as weights, their exact errors, lower bounds."""
