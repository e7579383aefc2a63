"""Physics that takes orders: channels of a shot."""
