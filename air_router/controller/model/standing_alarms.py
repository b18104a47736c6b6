"""Alarms that last until their condition is over, or until the pilot takes over.

An alarm is announced once. While its condition lasts, it is repeated with the instruction to take
over by hand, at intervals that keep announcements readable.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from air_router.controller.model.actions import Announce
from air_router.controller.model.limits import ESCALATES_S, REPEATED_S
from air_router.vehicle import TAKE_OVER_NOW, Instruction, Severity


@dataclass(frozen=True, slots=True)
class StandingAlarm:
    """One alarm that lasts.

    Attributes:
        lasting: Text of the repetition; a duration follows it.
        instruction: Action of the pilot or the operator; a repetition has a stronger one.
        since_s: Start of the condition, vehicle's clock.
        again_s: Time of the next repetition.
    """

    lasting: str
    instruction: Instruction
    since_s: float
    again_s: float


@dataclass(slots=True, eq=False)
class StandingAlarms:
    """All alarms that last, by subject."""

    _standing: dict[str, StandingAlarm] = field(default_factory=dict)

    def stand(
        self, about: str, lasting: str, instruction: Instruction, now_s: float, since_s: float
    ) -> bool:
        """Add an alarm; return whether it is new."""
        new = about not in self._standing
        if new:
            again_s = now_s + ESCALATES_S
            self._standing[about] = StandingAlarm(lasting, instruction, since_s, again_s)
        return new

    def end(self, about: str) -> bool:
        """End an alarm; return whether it was up."""
        return self._standing.pop(about, None) is not None

    def end_all(self) -> None:
        """End all alarms: the pilot took over, or the vehicle is taken back."""
        self._standing.clear()

    def due(self, now_s: float) -> list[Announce]:
        """The alarms to repeat now."""
        announcements = []
        for about, alarm in self._standing.items():
            if now_s >= alarm.again_s:
                self._standing[about] = StandingAlarm(
                    alarm.lasting, alarm.instruction, alarm.since_s, now_s + REPEATED_S
                )
                text = f"{alarm.lasting} for {now_s - alarm.since_s:.0f} s"
                announcements.append(Announce(text, Severity.ALARM, TAKE_OVER_NOW, about))
        return announcements

    @property
    def shown(self) -> dict[str, StandingAlarm]:
        """The alarms that last, by subject, oldest first."""
        return dict(self._standing)
