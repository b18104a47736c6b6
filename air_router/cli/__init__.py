"""The command line `air-router`: one module per command."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "arguments": (
            "ANY_FINITE",
            "MORE_THAN_0",
            "px4_version_option",
            "rover_option",
            "start_option",
            "uav_option",
            "home",
            "note_options",
            "number",
            "print_json",
            "say",
            "speed_factor",
        ),
        "cli": ("program_of",),
        "fly": ("PART", "flight_options", "finish", "fly_mission", "refusing"),
    },
)
