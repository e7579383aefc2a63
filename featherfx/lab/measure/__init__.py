"""Measurements of the program itself: its size, times, memory and accuracy."""
