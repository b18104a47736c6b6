"""When there is nothing more to be seen of a rehearsed flight."""

from __future__ import annotations

from typing import Final

MOST_S: Final = 600.0
PILOT_S: Final = 25.0
"""For so long a pilot (or nothing) is watched after the vehicle was given away."""

LANDED_S: Final = 10.0
"""What a companion gets to end its flight once the vehicle is disarmed."""

_REFUSED_S: Final = 5.1
"""A companion that has ended until then, and left the vehicle disarmed, was refused."""


class Ending:
    """Follows a flight to its end.

    Attributes:
        flown: Whether the vehicle was armed.
    """

    def __init__(self) -> None:
        self.flown = False
        self._disarmed_s: float | None = None  # after a flight; None again once it is armed
        self._given_away_s: float | None = None  # since then no companion has it, or will

    def has_come(self, now_s: float, in_charge: bool | None, *, armed: bool, done: bool) -> bool:
        """Look at it, some times a second.

        Args:
            now_s: Simulated seconds.
            in_charge: Whether the companion holds the vehicle for its own; None: there is none.
            armed: Whether the vehicle is.
            done: Whether everything that can happen has happened.
        """
        if armed:
            self.flown, self._disarmed_s = True, None
        elif self.flown and self._disarmed_s is None:
            self._disarmed_s = now_s
        if now_s > MOST_S or (self._disarmed_s is not None and now_s > self._disarmed_s + LANDED_S):
            return True
        if in_charge is None and not self.flown and now_s > _REFUSED_S:
            return True
        given_away = in_charge is None or (self.flown and not in_charge)
        if not given_away or not done or not armed:
            self._given_away_s = None
        elif self._given_away_s is None:
            self._given_away_s = now_s
        return self._given_away_s is not None and now_s > self._given_away_s + PILOT_S
