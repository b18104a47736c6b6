"""The simulated world as a process: its clock, its links that can be cut, its gossip nodes."""
