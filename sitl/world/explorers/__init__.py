"""Ground robots that search a town for vehicles: what they know, decide and publish."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "exploration": ("Exploration", "first_visits"),
        "explorer": ("GroundRobot", "NO_VEHICLE_M", "Visit"),
        "messages": (
            "CLAIMS_TOPIC",
            "OBJECTS_TOPIC",
            "POLICY_TOPIC",
            "REACHABILITY_TOPIC",
            "degrees",
        ),
        "policies": (
            "Drive",
            "Received",
            "RobotPolicy",
            "RobotPolicyError",
            "RobotView",
            "check_choice",
            "robot_policy_of",
        ),
        "settings": ("ExplorerSettings", "PlacedBy", "Positive"),
    },
)
