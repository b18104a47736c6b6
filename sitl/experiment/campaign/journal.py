"""What was done to a campaign and when: time stamps show whether a clock or a result ended it.

`DIR/journal.jsonl` has a line of JSON for each time that runs were begun, stopped or evaluated:

    {"at": "2026-11-29T16:02:11Z", "event": "begun", "declaration": "<SHA-256 of the file>", ...}
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from mocha_link.path_safety import check_links
from sitl.experiment import StopRule, Task

JOURNAL_NAME: Final = "journal.jsonl"


def utc_now() -> datetime:
    """The present."""
    return datetime.now(UTC)


def stamp(time: datetime) -> str:
    """A time as records have it, to a second."""
    return time.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


class Journal:
    """The journal in a folder, which is there.

    Args:
        folder: Of the campaign.
        now: The clock.
    """

    def __init__(self, folder: Path, now: Callable[[], datetime] = utc_now) -> None:
        self._path = folder / JOURNAL_NAME
        self._now = now

    def note(self, event: str, **what: Any) -> None:
        """Add a line: what happened, and details in plain values."""
        check_links(self._path)
        line = json.dumps({"at": stamp(self._now()), "event": event, **what})
        with self._path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")


class StopClock:
    """Decides which runs of a campaign may still be begun.

    Args:
        rule: What was declared; None: all may.
        begun: Seed numbers that have runs.
        now: The clock.

    Attributes:
        stopped: It has refused one.
    """

    def __init__(
        self, rule: StopRule | None, begun: Iterable[int], now: Callable[[], datetime] = utc_now
    ) -> None:
        self._rule = rule
        self._begun = set(begun)  # seed numbers, which are made whole
        self._now = now
        self.stopped = False

    def may_begin(self, task: Task) -> bool:
        """Whether a run may be begun now."""
        late = self._rule is not None and self._now() >= self._rule.begin_before
        if late and task.number not in self._begun:
            self.stopped = True
            return False
        self._begun.add(task.number)
        return True
