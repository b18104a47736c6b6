"""One flight: the asyncio shell around controller, vehicle and gossip."""
