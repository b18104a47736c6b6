"""How the simulated vehicle moves, and what it believes of that."""
