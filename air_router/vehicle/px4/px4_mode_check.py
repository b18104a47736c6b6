"""Requests the current flight mode of a PX4, and waits for an answer sent after the request.

HEARTBEAT reports the mode once a second, and while this program stalls a socket keeps the oldest
messages until it is full. So a received mode may predate a pilot's choice. Here a HEARTBEAT is
requested. It counts if it follows a message that must have been sent after the request: the echo of
a TIMESYNC sent with it, or a message with a `time_boot_ms` that is no earlier. The link keeps the
order; lost requests are repeated.
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
    """A pending request, and the proof that an answer was sent after it.

    Attributes:
        first: `ts1` of the first TIMESYNC sent for it; later ones are greater.
        boot_s: The vehicle's time at the request, as far as it is known.
        proven: A message was received that was sent after the request.
        answered: After that, a mode was received.
    """

    first: int
    boot_s: float
    proven: bool = False
    answered: bool = False

    def begin_anew(self, now: _ModeRequest) -> None:
        """Earlier requests and replies do not count anymore."""
        self.first, self.boot_s = now.first, now.boot_s
        self.proven = self.answered = False

    def take(self, name: str, fields: Mapping[str, Any]) -> None:
        """Handle any message, in the order of the link."""
        if name == "TIMESYNC":
            self.proven |= fields["tc1"] != 0 and fields["ts1"] >= self.first
        elif name in MODES:
            self.answered |= self.proven
        elif (boot_ms := fields.get("time_boot_ms")) is not None:
            self.proven |= boot_ms / 1e3 >= self.boot_s


class ModeCheck:
    """Requests the flight mode of a PX4.

    Args:
        messages: The vehicle's messages in both directions.
    """

    def __init__(self, messages: Px4Messages) -> None:
        self._messages = messages
        self._newest = 0  # `ts1` of the latest TIMESYNC sent
        self._open: list[_ModeRequest] = []  # pending requests

    def listen(self) -> None:
        """Handle PX4's messages from now on."""
        self._messages.take({"TIMESYNC": self._on_timesync})
        self._messages.watch(self._on_message)

    async def received(self, limit_s: float = MODE_RESPONSE_S) -> bool:
        """Whether a mode was received that the vehicle has had since this call.

        If True, the mode was received a moment ago and this program has not stalled since the
        request: the caller may rely on it in the same turn of the loop.

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
                answered = await self._messages.shows(lambda: request.answered, STOOD_STILL_CHECK_S)
                if loop_s() - checked_s > LINK_GAP_S:  # it stalled, and the answer may be old
                    request.begin_anew(self._question())
                    requested_s = -math.inf
                elif answered:
                    return True
        finally:
            self._open.remove(request)
        return False

    def _question(self) -> _ModeRequest:
        return _ModeRequest(self._stamp(), self._messages.clock.boot_s())

    def _stamp(self) -> int:
        """A time in nanoseconds, different from every earlier TIMESYNC of ours."""
        return max(self._newest + 1, round(loop_s() * 1e9))

    def _request_mode(self) -> None:
        """Request a HEARTBEAT after a TIMESYNC."""
        self._newest = self._stamp()
        self._messages.send("TIMESYNC", {"tc1": 0, "ts1": self._newest}, to_all=True)
        self.request()

    def request(self) -> None:
        """Request a HEARTBEAT; its mode may predate an earlier command of ours."""
        params = {f"param{n}": 0.0 for n in range(1, 8)} | {"param1": float(MessageId.HEARTBEAT)}
        self._messages.send(
            "COMMAND_LONG", {"command": MavCmd.REQUEST_MESSAGE, "confirmation": 0, **params}
        )

    def _on_timesync(self, fields: Mapping[str, Any]) -> None:
        """Handle a TIMESYNC (our echo, or a request), in order with all messages."""

    def _on_message(self, name: str, fields: Mapping[str, Any]) -> None:
        for request in self._open:
            request.take(name, fields)
            if request.proven:
                self._messages.up_to_date()
