"""Many runs: in processes or on a cluster, stored, repeated."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "campaign": ("Campaign", "Work", "make_runs"),
        "cluster": ("Cluster", "cluster_at"),
        "journal": ("Journal", "StopClock"),
        "provenance": ("program",),
        "remaking": ("Remade", "remade", "remakeable"),
        "running": ("make_run", "put_together", "settings_of"),
        "runs": ("ARCHIVE_ENDING", "RunLog", "read_archive", "run_log", "write_archive"),
    },
)
