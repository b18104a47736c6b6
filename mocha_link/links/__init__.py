"""Link events and metrics, for other planners to embed."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "link_table": ("LinkTable", "QUIET_CONTACT_S", "throughput_bytes_s"),
        "metrics": (
            "Contact",
            "ContactBegan",
            "ContactEnded",
            "Direction",
            "LinkEvent",
            "LinkMetrics",
            "LinkState",
            "MessageStored",
            "RssiChanged",
            "StorageFailed",
            "StorageRecovered",
            "SyncEnded",
            "SyncStarted",
            "SyncTimedOut",
        ),
        "reading": ("Reading", "Unit", "as_reading"),
        "trigger": ("NO_SIGNAL", "SILENT_INTERVALS", "SyncTrigger", "threshold"),
    },
)
