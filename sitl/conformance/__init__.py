"""Scripted conversations with a PX4: what it answers, measured on a real one, and held to."""
