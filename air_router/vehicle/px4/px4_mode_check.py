"""Which flight mode a PX4 has now: requested, and known by an answer that was sent afterwards.

HEARTBEAT tells the mode once a second, and a socket keeps what came while this program stood
still: the oldest, until it is full. So a mode that was received says what the vehicle did, perhaps
before a pilot chose. Here a HEARTBEAT is requested, and one counts that follows what can only have
been sent after the request: the echo of a TIMESYNC that left with it, or else a message whose
`time_boot_ms` is no earlier. A link keeps the order; what it loses is requested again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from air_router.vehicle import loop_s
from air_router.vehicle.px4.limits import (
    LINK_GAP_S,
    MODE_REQUESTED_AGAIN_S,
    MODE_RESPONSE_S,
    STOOD_STILL_CHECK_S,
)
from air_router.vehicle.px4.mavlink_values import MavCmd, MessageId
from air_router.vehicle.px4.px4_messages import MODES, Px4Messages


@dataclass(slots=True)
class _ModeRequest:
    """What proves that an answer was sent after it was requested.

    Attributes:
        first: The first TIMESYNC that left for it has this `ts1`, later ones a greater.
        boot_s: The vehicle's time when it was asked, as far as it is known.
        proven: Something came that was sent since.
        acknowledged: After that, a mode came.
    """

    first: int
    boot_s: float
    proven: bool = False
    acknowledged: bool = False

    def begin_anew(self, now: _ModeRequest) -> None:
        """Requests and replies before this count no more."""
        self.first, self.boot_s = now.first, now.boot_s
        self.proven = self.acknowledged = False

    def take(self, name: str, fields: Mapping[str, Any]) -> None:
        """Any message came, in the order of the link."""
        if name == "TIMESYNC":
            self.proven |= fields["tc1"] != 0 and fields["ts1"] >= self.first
        elif name in MODES:
            self.acknowledged |= self.proven
        elif (boot_ms := fields.get("time_boot_ms")) is not None:
            self.proven |= boot_ms / 1e3 >= self.boot_s


class ModeCheck:
    """Requests the flight mode of a PX4.

    Args:
        messages: Takes them to it, and from it.
    """

    def __init__(self, messages: Px4Messages) -> None:
        self._messages = messages
        self._newest = 0  # `ts1` of the latest TIMESYNC that left
        self._open: list[_ModeRequest] = []  # that are waited for

    def listen(self) -> None:
        """Take what the autopilot says, from now on."""
        self._messages.take({"TIMESYNC": self._on_timesync})
        self._messages.watch(self._on_message)

    async def received(self, limit_s: float = MODE_RESPONSE_S) -> bool:
        """Whether a mode has come that the vehicle had after this was called.

        When it returns True that mode was taken in a moment ago, and this program has not stood
        still since it asked: what follows in the same turn of the loop rests on it.

        Args:
            limit_s: Wall-clock limit.
        """
        end_s, requested_s = loop_s() + limit_s, -math.inf
        request = self._question()
        self._open.append(request)
        try:
            while (checked_s := loop_s()) < end_s:
                if checked_s - requested_s >= MODE_REQUESTED_AGAIN_S:
                    self._request_mode()
                    requested_s = checked_s
                acknowledged = await self._messages.shows(
                    lambda: request.acknowledged, STOOD_STILL_CHECK_S
                )
                if loop_s() - checked_s > LINK_GAP_S:  # it stood still, and the answer may be old
                    request.begin_anew(self._question())
                    requested_s = -math.inf
                elif acknowledged:
                    return True
        finally:
            self._open.remove(request)
        return False

    def _question(self) -> _ModeRequest:
        return _ModeRequest(self._stamp(), self._messages.clock.boot_s())

    def _stamp(self) -> int:
        """A time in nanoseconds that no TIMESYNC of ours has had."""
        return max(self._newest + 1, round(loop_s() * 1e9))

    def _request_mode(self) -> None:
        """Request a HEARTBEAT, behind a TIMESYNC."""
        self._newest = self._stamp()
        self._messages.send("TIMESYNC", {"tc1": 0, "ts1": self._newest}, to_all=True)
        self.request()

    def request(self) -> None:
        """Have the vehicle send a HEARTBEAT; what it says may be from before some order of ours."""
        params = {f"param{n}": 0.0 for n in range(1, 8)} | {"param1": float(MessageId.HEARTBEAT)}
        self._messages.send(
            "COMMAND_LONG", {"command": MavCmd.REQUEST_MESSAGE, "confirmation": 0, **params}
        )

    def _on_timesync(self, fields: Mapping[str, Any]) -> None:
        """An echo of ours, or a question of the vehicle's: checked with all, in their order."""

    def _on_message(self, name: str, fields: Mapping[str, Any]) -> None:
        for request in self._open:
            request.take(name, fields)
            if request.proven:
                self._messages.up_to_date()
