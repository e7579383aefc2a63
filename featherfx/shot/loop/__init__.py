"""The frame loop of a shot, its stages, and the batches of feathers that it steps.

Change here: a stage, a checkpoint, what a report counts.
"""
