"""What an experiment is made of: settings, events in simulated time, the lattice of a town."""
