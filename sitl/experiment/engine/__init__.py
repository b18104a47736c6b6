"""One run in simulated time: its radio channel, what happens in it, and what it amounts to."""
