"""Flights in which something goes wrong, and a judge that knows nothing of how they are flown."""
