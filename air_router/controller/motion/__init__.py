"""The one way to move the vehicle: legs checked, commanded, and watched until they show."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "command_gate": ("CommandGate", "MODES", "REACTION_S", "RETRY_S", "stopping_point"),
        "initial_climb": ("ALTITUDE_M", "ClimbWatch", "InitialClimb", "below"),
        "navigator": ("Navigator",),
        "way_out": ("nearest_way_out",),
    },
)
