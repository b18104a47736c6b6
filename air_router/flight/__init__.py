"""One flight: connects controller, vehicle and gossip node on the asyncio event loop."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "flight": ("Flight",),
        "flight_loop": ("CommandService",),
        "flight_stats": ("FlightResult", "FlightStats", "FlownTrack"),
        "flight_view": ("FlightView", "situation"),
        "limits": ("COMMAND_S",),
        "resumption": ("as_begun",),
        "terminal": ("StatusLine", "line_of"),
    },
)
