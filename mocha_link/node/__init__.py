"""The node: its gossip core (pure), its thread, sockets and connections."""
