"""What a user feels, each figure with its goal and beside an anchor; run by `make bench-goals`."""
