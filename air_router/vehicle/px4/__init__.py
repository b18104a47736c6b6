"""A PX4 vehicle: its link, messages with plausibility checks, commands, and the plan on board."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "key_provisioning": ("provide", "remove"),
        "limits": ("FIND_S",),
        "mavlink_values": ("COMPANION_COMPONENT",),
        "px4": ("Px4Vehicle",),
        "px4_connection": ("Plugins", "Px4Connection"),
        "signing_key": ("SigningKey",),
        "versions": (
            "FACTS",
            "FLOWN",
            "NEWEST",
            "OLDEST",
            "Version",
            "VersionFact",
            "name_of",
            "version_of",
        ),
    },
)
