"""A simulated world around a flight, each part of it a process of its own."""
