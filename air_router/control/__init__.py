"""Requests from the operator and from programs: parsed, limited, served."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "command_request": (
            "Budget",
            "COSTLY_AT_ONCE",
            "COSTLY_PER_S",
            "CommandRequest",
            "MODELS",
            "RequestHandler",
            "TOO_MANY",
            "View",
            "command_request_of",
            "parse_command",
        ),
        "control": (
            "CONTROL_NAME",
            "ControlReply",
            "ControlClient",
            "ControlError",
            "ControlUnreachableError",
            "endpoint_of",
        ),
        "control_server": ("ControlServer",),
    },
)
