"""featherfx: from feather grooms to simulated, time-sampled USD geometry."""

__version__ = "0.1.0"
