"""Machine axes: the motor of the paper and others, each in one file."""
