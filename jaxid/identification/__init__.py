"""From recorded logs to guaranteed parameter intervals, or to a proof of inconsistency."""
