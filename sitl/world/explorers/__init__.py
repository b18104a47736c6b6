"""Ground robots that look for vehicles in a town: what they know, decide and tell."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "exploration": ("Exploration", "first_visits"),
        "explorer": ("GroundRobot", "NO_VEHICLE_M", "Visit"),
        "messages": ("CLAIMS_TOPIC", "OBJECTS_TOPIC", "REACHABILITY_TOPIC", "degrees"),
        "settings": ("ExplorerSettings", "PlacedBy", "Positive"),
    },
)
