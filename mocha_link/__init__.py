"""Gossip node for robots whose links come and go. Usable alone: imports nothing of ours."""
