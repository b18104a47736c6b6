"""One run in simulated time, and what it amounts to."""
