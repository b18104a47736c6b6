"""The record of a flight: writing, reading, replaying."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "foxglove_sdk": ("foxglove_mcap",),
        "log": ("Log", "Note", "RecordEntry"),
        "record_file": ("no_folder",),
        "recorder": ("Recorder",),
        "recording": (
            "ViewerAddress",
            "record_argument",
            "recording_options",
            "viewer_option",
            "folder_of",
            "record_of",
            "viewing",
        ),
        "replay": ("RecordedStep", "Replayer", "replay_record", "steps_of"),
        "serialization": ("json_of", "plain_of"),
    },
)
