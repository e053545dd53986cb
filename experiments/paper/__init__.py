"""The paper's experiment on its linear motor: `python -m experiments.paper`."""
