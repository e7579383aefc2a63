"""Stacking order of plumage as it is written, frame by frame.

Change here: order, lifts, depths.
"""
