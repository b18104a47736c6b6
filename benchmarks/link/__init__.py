"""How much of what a radio contact allows gets across; run by `make bench-link`."""
