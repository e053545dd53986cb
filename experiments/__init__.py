"""Programs that use the library: studies, checks and benchmarks."""
