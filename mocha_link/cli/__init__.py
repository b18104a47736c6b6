"""The command line `mocha-link`: one module per command."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "program": (
            "Command",
            "Decorator",
            "Options",
            "PATH",
            "Parsed",
            "Program",
            "coloured",
            "command",
            "option",
            "optional",
            "options_of",
            "together",
        ),
    },
)
