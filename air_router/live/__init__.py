"""The map page of a flight."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "joint": ("JointPage",),
        "playback": ("Playback", "RecordedFlight"),
        "scene": ("scenery",),
        "server": ("LivePage",),
    },
)
