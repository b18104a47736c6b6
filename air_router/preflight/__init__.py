"""Pre-flight checks: whether mission, vehicle and battery are fit for the flight."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "card": ("BAD", "Card", "Check", "GOOD", "LOOK", "PreflightRefusedError"),
        "check_facts": ("facts_of", "summary"),
        "preflight_survey": ("PreflightSurvey",),
        "survey": ("MissionSurvey", "closest_approach", "route_time_s"),
        "world_check": ("WorldUncheckedError", "check_world", "world_notes"),
    },
)
