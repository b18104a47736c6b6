"""Flights with injected faults, and an independent judge."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "companion": ("SimulatedLoop",),
        "courses": (
            "Agenda",
            "BATTERY",
            "BRIEF_S",
            "Course",
            "Draw",
            "ITEM",
            "LANDED",
            "MODE",
            "POSITION",
            "Row",
            "SATELLITES",
            "Schedule",
            "ScheduledFault",
            "carry_out",
            "choice",
            "one",
            "placed",
            "steps",
            "uniform",
        ),
        "faults": ("Fault", "Scene", "scenes"),
        "inspections": ("CLAIMS", "SENDERS"),
        "mission_file": ("ANOTHER", "MissionFile", "hurried"),
        "scenario": ("SceneOverError",),
        "simulated_flight": ("SimulatedFlight",),
        "strangers": ("ImpersonatedState", "false_messages"),
        "zone_terms": ("with_terms",),
    },
)
