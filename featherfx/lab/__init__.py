"""Virtual experiments and benchmarks; nothing outside depends on it."""
