"""Readers of groom files, which report every problem at once.

Change here: a form in which feathers are given.
"""
