"""Shots: the motion of a groom over time, frame by frame.

Change here: the order of stages within a frame.
"""
