"""Every key that a user may write, declared once.

Change here: a key, its range, its help.
"""
