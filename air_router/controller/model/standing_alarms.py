"""Alarms that go on until their condition is over, or the pilot has the vehicle.

An alarm is announced once. While the condition lasts unanswered the alarm is repeated: then the
pilot takes the vehicle by hand. The interval is bounded, so that announcements stay readable.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from air_router.controller.model.actions import Announce
from air_router.controller.model.limits import ESCALATES_S, REPEATED_S
from air_router.vehicle import TAKE_OVER_NOW, Instruction, Severity


@dataclass(frozen=True, slots=True)
class StandingAlarm:
    """One of them.

    Attributes:
        lasting: What goes on, in words that a duration follows.
        instruction: What the pilot or the operator does; repeated it is more severe.
        since_s: Since when, vehicle's clock.
        again_s: When it is repeated.
    """

    lasting: str
    instruction: Instruction
    since_s: float
    again_s: float


@dataclass(slots=True, eq=False)
class StandingAlarms:
    """All that stand, by what they are about."""

    _standing: dict[str, StandingAlarm] = field(default_factory=dict)

    def stand(
        self, about: str, lasting: str, instruction: Instruction, now_s: float, since_s: float
    ) -> bool:
        """It goes on from now on; whether that is new."""
        new = about not in self._standing
        if new:
            again_s = now_s + ESCALATES_S
            self._standing[about] = StandingAlarm(lasting, instruction, since_s, again_s)
        return new

    def end(self, about: str) -> bool:
        """It is over, or answered; whether it stood."""
        return self._standing.pop(about, None) is not None

    def end_all(self) -> None:
        """The pilot has the vehicle, or it is taken back: all that was requested is answered."""
        self._standing.clear()

    def due(self, now_s: float) -> list[Announce]:
        """Those that are to be repeated now."""
        said = []
        for about, alarm in self._standing.items():
            if now_s >= alarm.again_s:
                self._standing[about] = StandingAlarm(
                    alarm.lasting, alarm.instruction, alarm.since_s, now_s + REPEATED_S
                )
                text = f"{alarm.lasting} for {now_s - alarm.since_s:.0f} s"
                said.append(Announce(text, Severity.ALARM, TAKE_OVER_NOW, about))
        return said

    @property
    def shown(self) -> dict[str, StandingAlarm]:
        """Those that stand now, by what they are about; the oldest first."""
        return dict(self._standing)
