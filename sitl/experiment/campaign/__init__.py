"""Many runs: made in processes or on a cluster, stored, and made again."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "campaign": ("Campaign", "Work", "duration_text", "make_runs"),
        "journal": ("Journal", "StopClock", "stamp", "utc_now"),
        "running": ("make_run", "put_together"),
        "runs": ("ARCHIVE_ENDING", "RunLog", "program", "read_archive", "run_log", "write_archive"),
    },
)
