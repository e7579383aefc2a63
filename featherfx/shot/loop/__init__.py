"""The frame loop of a shot, and what it steps: batches of feathers."""
