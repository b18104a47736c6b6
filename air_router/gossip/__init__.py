"""The UAV's gossip node: messages to and from the team."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "gossip": ("Gossip", "MAP_INTERVAL_S"),
        "interactions": ("ContactSpan", "Interactions", "Sync"),
        "limits": ("MARGIN_M", "RESOLUTION_M"),
        "mapper": ("Mapper", "receive_patches"),
        "ros_messages": ("Datum", "MAP_FRAME", "occupancy_of", "readers_of", "stamp"),
        "team_messages": ("TeamMessageDecoder",),
    },
)
