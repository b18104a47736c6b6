"""The table of states and their handlers: exploring, seeking, hovering, coming home."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "explore_state": ("Exploration",),
        "goto_state": ("Accepted", "GotoValidator"),
        "ready_state": ("HOME_TOLERANCE_M",),
        "return_state": ("HomeReachability", "landing_radius_m"),
        "search_points": ("Search",),
        "table": ("STATES", "StateHandlers", "transitions"),
    },
)
