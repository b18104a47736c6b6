"""Experiments: towns full of robots in simulated time, thousands of times faster than real."""
