"""Edits mission files on a map: the text stays as it is, but for the values that were changed."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "edits": ("Move",),
        "server": ("EditorServer",),
        "session": ("EditSession", "MissionFile", "write_starter"),
    },
)
