"""Shots: what happens to a groom over time, frame by frame."""
