"""The edit page: edits missions on a map, in place in the text of their files."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "edits": ("Move",),
        "server": ("EditorServer",),
        "session": ("EditSession", "MissionFile", "write_starter"),
    },
)
