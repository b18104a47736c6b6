"""Which robot to seek next, and where it is and will be."""
