"""The transfers of missions, fences and rally points, as MAVSDK 4.1 does them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Protocol, Self

from mavsdk.plugins.mission_raw.mission_raw import MissionItem, MissionRawResult

from air_router.vehicle.px4.px4_connection import COMPANION_COMPONENT

AUTOPILOT: Final = 1
REPEAT_S: Final = 0.5
TRANSFER_REPEATS: Final = 4
_TRANSFER: Final = frozenset(
    {"MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK"}
)
_ACKS: Final = {
    0: MissionRawResult.SUCCESS,
    1: MissionRawResult.ERROR,
    2: MissionRawResult.UNSUPPORTED,
    3: MissionRawResult.UNSUPPORTED,
    4: MissionRawResult.TOO_MANY_MISSION_ITEMS,
    13: MissionRawResult.INVALID_SEQUENCE,
    14: MissionRawResult.DENIED,
    15: MissionRawResult.TRANSFER_CANCELLED,
}
ITEM: Final = (
    *("seq", "frame", "command", "current", "autocontinue", "param1", "param2", "param3"),
    *("param4", "x", "y", "z", "mission_type"),
)


Fields = Mapping[str, Any]


class Wire(Protocol):
    """The companion's end of the link."""

    def send(self, name: str, fields: Fields) -> None:
        """Send a message to the vehicle."""


class Listening(Protocol):
    """Who hands on what the vehicle says, and what is said to it.

    Attributes:
        wire: To the vehicle; may be cut at any time.
    """

    wire: Wire

    @property
    def system_id(self) -> int:
        """The vehicle's."""

    def listen(self, name: str, listener: Callable[[Fields], None]) -> Callable[[], None]:
        """Hand messages of a name to this; returns what ends it."""


class Transfer:
    """One upload, download or deletion of MAVLink's mission protocol."""

    def __init__(self, link: Listening, mission_type: int) -> None:
        self._link = link
        self._type = mission_type
        self._inbox: asyncio.Queue[tuple[str, Fields]] = asyncio.Queue()  # ours, of `_TRANSFER`
        self._ends: list[Callable[[], None]] = []  # end its listening

    def __enter__(self) -> Self:
        for name in _TRANSFER:
            self._ends.append(self._link.listen(name, self._taker(name)))
        return self

    def __exit__(self, *_: object) -> None:
        for end in self._ends:
            end()

    async def upload(self, items: Sequence[Fields]) -> MissionRawResult:
        """Send items, as the vehicle asks for them."""
        last = ("MISSION_COUNT", {"count": len(items), "opaque_id": 0})
        while True:
            answer = await self._ask(*last, {"MISSION_REQUEST_INT", "MISSION_REQUEST"})
            if answer is None:
                return MissionRawResult.TIMEOUT
            name, fields = answer
            if name == "MISSION_ACK":
                return _ACKS.get(fields["type"], MissionRawResult.ERROR)
            last = ("MISSION_ITEM_INT", dict(items[fields["seq"]]))

    async def download(self) -> tuple[MissionRawResult, list[MissionItem]]:
        """Ask for everything on board."""
        answer = await self._ask("MISSION_REQUEST_LIST", {}, {"MISSION_COUNT"})
        if answer is None:
            return MissionRawResult.TIMEOUT, []
        if answer[0] == "MISSION_ACK":
            return _ACKS.get(answer[1]["type"], MissionRawResult.ERROR), []
        count, items = answer[1]["count"], list[MissionItem]()
        while len(items) < count:
            answer = await self._ask(
                "MISSION_REQUEST_INT",
                {"seq": len(items)},
                {"MISSION_ITEM_INT"},
                wanted=lambda fields: fields["seq"] == len(items),
            )
            if answer is None:
                return MissionRawResult.TIMEOUT, []
            if answer[0] == "MISSION_ACK":
                return MissionRawResult.ERROR, []
            items.append(MissionItem(**{name: answer[1][name] for name in ITEM}))
        self._send("MISSION_ACK", {"type": 0, "opaque_id": 0})
        none = MissionRawResult.NO_MISSION_AVAILABLE
        return (MissionRawResult.SUCCESS if count else none), items

    async def clear(self) -> MissionRawResult:
        """Delete everything on board."""
        answer = await self._ask("MISSION_CLEAR_ALL", {}, set())
        if answer is None:
            return MissionRawResult.TIMEOUT
        return _ACKS.get(answer[1]["type"], MissionRawResult.ERROR)

    async def _ask(
        self,
        name: str,
        fields: dict[str, Any],
        names: set[str],
        *,
        wanted: Callable[[Fields], bool] = lambda _: True,
    ) -> tuple[str, Fields] | None:
        """Send until one of these, or an acknowledgement, comes."""
        for _ in range(TRANSFER_REPEATS + 1):
            self._send(name, fields)
            try:
                async with asyncio.timeout(REPEAT_S):
                    while True:
                        answer = await self._inbox.get()
                        if answer[0] == "MISSION_ACK" or (answer[0] in names and wanted(answer[1])):
                            return answer
            except TimeoutError:
                continue
        return None

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        target = {"target_system": self._link.system_id, "target_component": AUTOPILOT}
        self._link.wire.send(name, {**target, "mission_type": self._type, **fields})

    def _taker(self, name: str) -> Callable[[Fields], None]:
        def take(fields: Fields) -> None:
            to = (fields["target_system"], fields["target_component"])
            ours = to in {(self._link.system_id, COMPANION_COMPONENT), (0, 0)}
            if ours and fields.get("mission_type", 0) == self._type:
                self._inbox.put_nowait((name, fields))

        return take
