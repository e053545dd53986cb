"""The experiment: plant, controller, sensor and disturbance in closed loop, and its data."""
