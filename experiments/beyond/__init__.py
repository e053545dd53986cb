"""Studies beyond the paper, one in each file: `python -m experiments.beyond.<name>`."""
