"""Readers of shot files, which report every problem at once.

Change here: a key of shots.
"""
