"""Pictures of missions, and the report of a completed flight."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "figure_style": ("Ink",),
        "flight_history": ("FlightHistory", "history_of"),
        "flight_page": ("page_of",),
        "flight_table": ("several", "table", "went_on_without"),
        "map_sheet": ("MapSheet",),
        "picture": ("draw_coverage", "draw_mission"),
    },
)
