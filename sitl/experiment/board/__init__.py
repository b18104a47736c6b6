"""The leaderboard: policies on a fixed test set."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "board": ("BASELINE", "Standing", "read_board", "standing", "table_text", "write_board"),
        "testset": ("FINGERPRINT", "NEVER", "TEST_SET", "ChangedSetError", "entries", "frozen_set"),
    },
)
