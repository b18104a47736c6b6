"""`make bench-route`: how fast, how short and how lean routes are, beside other programs."""
