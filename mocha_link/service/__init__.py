"""A node's messages and metrics for other programs on the same machine."""
