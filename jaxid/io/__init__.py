"""Files and pictures: tables, trajectories, recorded logs, set-points, plots."""
