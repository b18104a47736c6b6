"""The robots of a run: base station, UAVs, and all gossip nodes."""
