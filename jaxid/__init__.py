"""Experimental design and guaranteed parameter intervals for machine axes, in JAX."""
