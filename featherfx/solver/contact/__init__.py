"""One interval of time for feathers that touch.

Change here: contact search, contact forces.
"""
