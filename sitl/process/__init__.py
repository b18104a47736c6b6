"""Simulated and real vehicles as processes: started, paced, terminated."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "end_with_parent": ("ending_with_us", "stop_signal"),
        "pace": ("Pace",),
        "pace_link": ("FollowedPace", "PaceServer"),
        "px4_install": ("ENVIRONMENT", "IMAGE", "Px4Install", "find_px4"),
        "px4_process": ("AIRFRAMES", "Px4Process", "Px4Settings"),
        "vehicle": (
            "Address",
            "LinkAddresses",
            "HERE",
            "PortInUseError",
            "Ports",
            "VehicleProcess",
            "px4_ports",
        ),
    },
)
