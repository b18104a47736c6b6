"""The robots of a run: explorers, base station, UAVs, and their gossip nodes."""
