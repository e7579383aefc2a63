"""Virtual experiments on rectangular samples of a vane."""
