"""Many shots, or the shares of one, on several processes or machines as one job."""
