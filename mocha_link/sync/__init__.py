"""The protocol between two nodes, pure: the original one, and the sync of new nodes."""
