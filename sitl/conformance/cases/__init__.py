"""The conversations: what a PX4 1.17 was recorded to answer."""
