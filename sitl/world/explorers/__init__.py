"""Ground robots that look for vehicles in a town: what they know, decide and tell."""
