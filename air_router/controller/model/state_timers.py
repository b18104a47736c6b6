"""When a state's time is over, and when something that could not be done is tried again."""

from __future__ import annotations

from air_router.controller.model.behaviour import State
from air_router.files.settings import Timers


class Schedule:
    """The timers of the states, in seconds on the vehicle's clock, which never runs back here."""

    def __init__(self, timers: Timers) -> None:
        self.now_s = 0.0
        self._limits_s = {
            State.INIT: timers.init_s,
            State.SEARCH: timers.search_s,
            State.COMM: timers.communicate_s,
            State.EXPL: timers.explore_s,
            State.GOTO: timers.hold_s,
        }
        self._limit_s: float | None = None
        self._carried_s: float | None = None
        self._from_s: float | None = None
        self._retry_at_s: float | None = None

    def tick(self, now_s: float) -> None:
        """It is `now_s`."""
        self.now_s = max(self.now_s, now_s)

    def enter(self, state: State) -> None:
        """A state begins and with it its timer; SEARCH and GOTO count from their arrival."""
        self._limit_s = self._limits_s.get(state) if self._carried_s is None else self._carried_s
        self._carried_s = None
        self._from_s = None if state in {State.SEARCH, State.GOTO} else self.now_s
        self._retry_at_s = None

    def carry(self, limit_s: float) -> None:
        """The state that begins next lasts so long, instead of what the mission says."""
        self._carried_s = limit_s

    @property
    def running(self) -> bool:
        """Whether the state's timer has begun."""
        return self._from_s is not None

    def start(self) -> None:
        """The state's timer begins now."""
        self._from_s = self.now_s

    @property
    def left_s(self) -> float | None:
        """Seconds until the state's timer ends, None while it does not run."""
        if self._limit_s is None or self._from_s is None:
            return None
        return max(0.0, self._limit_s - (self.now_s - self._from_s))

    @property
    def retrying(self) -> bool:
        """Whether something waits to be tried again."""
        return self._retry_at_s is not None

    def retry_in(self, pause_s: float) -> None:
        """Something is to be tried again after a pause."""
        self._retry_at_s = self.now_s + pause_s

    def take_retry(self) -> bool:
        """Whether it is time to try again; says so once."""
        if self._retry_at_s is None or self.now_s < self._retry_at_s:
            return False
        self._retry_at_s = None
        return True
