"""Run time against error, and stability under absurd input: what `featherfx bench` runs."""
