"""Whole tasks from file to file: bake, check, export, statistics, partitions.

Change here: an option of a bake, a report, a plan.
"""
