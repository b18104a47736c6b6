"""The team file: robots, topics, keys."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "document": ("Document", "MAX_BYTES", "as_yaml", "yaml_lines"),
        "error_text": ("Key", "as_label", "code_of", "request_error_text", "text_of_error"),
        "installed_radios": ("RADIO_GROUP", "radios_of_others"),
        "keys": (
            "KeyFileError",
            "KeyMismatchError",
            "PublicKey",
            "Seal",
            "SecretKey",
            "available",
            "peer_keys",
            "public_key",
            "require",
            "secret_key",
        ),
        "path_mistakes": ("path_advice",),
        "problem": (
            "DocumentError",
            "Problem",
            "ProblemList",
            "bytes_of",
            "line_column",
            "text_in",
        ),
        "team": (
            "Priority",
            "Robot",
            "Ros",
            "Team",
            "Topic",
            "Trigger",
            "Trust",
            "UnknownRobotError",
        ),
        "team_file": ("RadioUrl",),
        "value_mistakes": ("decimal_degrees", "number_advice", "pair_in", "plain"),
    },
    modules=("keys", "upstream"),
)
