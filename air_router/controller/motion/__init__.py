"""The only way to move the vehicle: legs are checked, commanded, and monitored until flown."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "command_gate": ("CommandGate",),
        "initial_climb": ("ClimbWatch", "InitialClimb", "below"),
        "interlocks": ("INTERLOCKS", "Blocked", "Interlock", "MotionOutcome", "raised"),
        "limits": ("ALTITUDE_M", "REACTION_S", "RETRY_S"),
        "navigator": ("Navigator",),
        "setpoints": ("MODES", "stopping_point"),
        "way_out": ("nearest_way_out",),
    },
)
