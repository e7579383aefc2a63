"""Virtual experiments, benchmarks and reference methods; nothing outside depends on it.

Change here: an experiment, a benchmark, a comparison with a publication.
"""
