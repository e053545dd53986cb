"""Benchmarks of the library, one module per question; `make bench` runs them all."""
