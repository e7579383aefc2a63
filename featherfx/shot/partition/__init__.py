"""Partitions of a shot for several workers, and what each feather depends on.

Change here: how a shot is divided.
"""
