"""The command line `sitl`: one module per command."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "rehearse_command": ("fly",),
    },
)
