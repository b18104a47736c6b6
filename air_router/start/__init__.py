"""A first mission with its team, world and rover, made from a few answers."""
