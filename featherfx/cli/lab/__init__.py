"""The commands of the virtual lab.

Change here: an option of an experiment.
"""
