"""Virtual experiments on rectangular samples of a vane: traction, locking, mesoscale, calibration."""
