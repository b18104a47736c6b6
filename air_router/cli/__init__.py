"""The command line `air-router`: one module per command."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "arguments": (
            "ANY_FINITE",
            "MORE_THAN_0",
            "add_px4_version",
            "add_rover",
            "add_start",
            "add_uav",
            "home",
            "note_options",
            "number",
            "print_json",
            "say",
            "speed_factor",
        ),
        "cli": ("program_of",),
        "fly": ("PART", "add_flight_arguments", "finish", "fly_mission", "refusing"),
    },
)
