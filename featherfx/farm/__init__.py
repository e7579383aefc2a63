"""Many shots, or partitions of one, on several processes or machines as one job.

Change here: `bake --engine dask`, the order of a job's work.
"""
