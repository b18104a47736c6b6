"""What `air_router` uses of MAVSDK, in this process and in simulated time.

Nothing but MAVSDK's C++ library is replaced: time-outs, repetitions, heartbeats and answers are
those of MAVSDK 4.1, messages are those that it would send.

A MISSION_ACK reaches a companion twice: as the result of its transfer, and as the message itself by
`MavlinkDirect`. MAVSDK's threads hand over either one first; the scene chooses which.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections import defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final, cast

from mavsdk.plugins.geofence.geofence import Geofence, GeofenceResult
from mavsdk.plugins.mavlink_direct.mavlink_direct import (
    MavlinkDirect,
    MavlinkDirectResult,
    MavlinkMessage,
)
from mavsdk.plugins.mission_raw.mission_raw import MissionItem, MissionRaw, MissionRawResult

from air_router.errors import NoVehicleError
from air_router.vehicle.px4 import COMPANION_COMPONENT, FIND_S, Plugins, Px4Connection

_AUTOPILOT: Final = 1
_REPEAT_S: Final = 0.5
_TRANSFER_REPEATS: Final = 4
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
_UNSUPPORTED: Final = 3  # MAV_MISSION_RESULT
_ITEM: Final = tuple(vars(MissionItem()))  # names of its fields
_HEARTBEAT: Final = {
    "type": 18,  # MAV_TYPE_ONBOARD_CONTROLLER
    "autopilot": 8,  # MAV_AUTOPILOT_INVALID
    "base_mode": 0,
    "custom_mode": 0,
    "system_status": 4,  # MAV_STATE_ACTIVE
    "mavlink_version": 3,
}
RESULT_FIRST_S: Final = 0.002
"""So much later than the result of a transfer its MISSION_ACK is handed over, where that is second.
What came after it waits behind it: `MavlinkDirect` keeps the order."""

_REPEATS: Final = 3
_IN_PROGRESS: Final = 5  # MAV_RESULT
_MISSION, _FENCE, _RALLY = 0, 1, 2  # MAV_MISSION_TYPE
_TEXTS: Final = frozenset({"param_id", "text"})

Fields = Mapping[str, Any]
FromAny = Callable[[Fields, tuple[int, int]], None]
"""Takes the fields of a message, and its system id and component id."""

Send = Callable[[str, Fields], object]
"""Sends a message to the vehicle: its name, and its fields."""


class StandIn(Px4Connection):
    """A connection to the vehicle in this process; one life of MAVSDK.

    Args:
        send: The companion's end of the link.
        url: As for the real one.
        system_id: The vehicle's.
        result_first: The result of a transfer is handed over before its MISSION_ACK.

    Attributes:
        send: The same; another one where the link is cut.
    """

    def __init__(self, send: Send, url: str, system_id: int, *, result_first: bool = False) -> None:
        super().__init__(url, system_id)
        self.send = send
        self._result_first = result_first
        self._waiting: deque[Callable[[], None]] = deque()  # for `MavlinkDirect`, in order
        self._listeners: defaultdict[str, list[Callable[[Fields], None]]] = defaultdict(list)
        self._direct: defaultdict[str, list[FromAny]] = defaultdict(list)
        self._connected = asyncio.Event()  # a HEARTBEAT of the vehicle was received
        self._tasks: list[asyncio.Task[None]] = []  # until it is closed
        self._transfers = asyncio.Lock()  # one at a time
        self.listen("HEARTBEAT", lambda _: self._connected.set())

    async def open(self) -> Plugins:
        """Wait for the vehicle's heartbeat, as MAVSDK does."""
        self.start(self._beat())
        try:
            async with asyncio.timeout(FIND_S):
                await self._connected.wait()
        except TimeoutError:
            raise NoVehicleError(f"nothing received within {FIND_S:.0f} s") from None
        return Plugins(
            cast("MavlinkDirect", _Direct(self)),
            cast("MissionRaw", _Raw(self)),
            cast("Geofence", _Fence(self)),
        )

    async def close(self) -> None:
        """End what goes on."""
        self._waiting.clear()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def receive(self, name: str, fields: Fields, sender: tuple[int, int] | None = None) -> None:
        """A message has come: of the vehicle, or of this system and component.

        `MavlinkDirect` hands on all of one system; the rest of MAVSDK knows its autopilot.
        """
        autopilot = (self.system_id, _AUTOPILOT)
        hand_on = partial(self._hand_on, name, fields, sender or autopilot)
        if self._waiting or (self._result_first and name == "MISSION_ACK"):
            self._waiting.append(hand_on)
            if len(self._waiting) == 1:
                asyncio.get_running_loop().call_later(RESULT_FIRST_S, self._hand_on_waiting)
        else:
            hand_on()
        if sender in {None, autopilot}:
            for listener in tuple(self._listeners.get(name, ())):
                listener(fields)

    def _hand_on(self, name: str, fields: Fields, sender: tuple[int, int]) -> None:
        for direct in tuple(self._direct.get(name, ())):
            direct(fields, sender)

    def _hand_on_waiting(self) -> None:
        while self._waiting:
            self._waiting.popleft()()

    def listen_to_all(self, name: str, listener: FromAny) -> Callable[[], None]:
        """Hand messages of a name to this, with their senders; returns what ends it."""
        self._direct[name].append(listener)
        return lambda: self._direct[name].remove(listener)

    def listen(self, name: str, listener: Callable[[Fields], None]) -> Callable[[], None]:
        """Hand messages of a name to this; returns what ends it."""
        self._listeners[name].append(listener)
        return lambda: self._listeners[name].remove(listener)

    def start(self, work: Any) -> None:
        """Do this beside everything else, until the end."""
        self._tasks.append(asyncio.get_running_loop().create_task(work))

    async def _beat(self) -> None:
        while True:
            self.send("HEARTBEAT", _HEARTBEAT)
            await asyncio.sleep(1.0)

    async def command(self, name: str, fields: dict[str, Any]) -> Fields | None:
        """Send a command until it is acknowledged; None: it never was."""
        acked = asyncio.Event()
        answer: list[Fields] = []

        def on_ack(ack: Fields) -> None:
            to = (ack["target_system"], ack["target_component"])
            if ack["command"] == fields["command"] and to == (self.system_id, COMPANION_COMPONENT):
                answer.append(ack)
                acked.set()

        end = self.listen("COMMAND_ACK", on_ack)
        try:
            for attempt in range(_REPEATS + 1):
                if not answer:
                    confirmation = {"confirmation": attempt} if name == "COMMAND_LONG" else {}
                    self.send(name, fields | confirmation)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_REPEAT_S):
                        await acked.wait()
                if acked.is_set() and answer[-1]["result"] != _IN_PROGRESS:
                    return answer[-1]
                acked.clear()
        finally:
            end()
        return None

    async def transfer(self, work: Callable[[_Transfer], Any], mission_type: int) -> Any:
        """One after the other: MAVSDK has one queue of them."""
        async with self._transfers:
            transfer = _Transfer(self, mission_type)
            with contextlib.ExitStack() as ends:
                for name in _TRANSFER:
                    ends.callback(self.listen(name, partial(transfer.take, name)))
                return await work(transfer)


class _Transfer:
    """One upload, download or deletion of MAVLink's mission protocol."""

    def __init__(self, link: StandIn, mission_type: int) -> None:
        self._link = link
        self._type = mission_type
        self._inbox: asyncio.Queue[tuple[str, Fields]] = asyncio.Queue()  # ours, of `_TRANSFER`

    def take(self, name: str, fields: Fields) -> None:
        """A message of the mission protocol was received from the vehicle."""
        to = (fields["target_system"], fields["target_component"])
        ours = to in {(self._link.system_id, COMPANION_COMPONENT), (0, 0)}
        if ours and fields.get("mission_type", 0) == self._type:
            self._inbox.put_nowait((name, fields))

    async def upload(self, items: Sequence[Fields]) -> MissionRawResult:
        """Send items, as the vehicle requests them."""
        last = ("MISSION_COUNT", {"count": len(items), "opaque_id": 0})
        while True:
            answer = await self._request(*last, {"MISSION_REQUEST_INT"})
            if isinstance(answer, MissionRawResult):
                return answer
            last = ("MISSION_ITEM_INT", dict(items[answer["seq"]]))

    async def download(self) -> tuple[MissionRawResult, list[MissionItem]]:
        """Request everything on board."""
        begun = await self._request("MISSION_REQUEST_LIST", {}, {"MISSION_COUNT"})
        if isinstance(begun, MissionRawResult):
            return begun, []
        items: list[MissionItem] = []
        while len(items) < begun["count"]:
            seq = {"seq": len(items)}
            answer = await self._request("MISSION_REQUEST_INT", seq, {"MISSION_ITEM_INT"}, seq)
            if isinstance(answer, MissionRawResult):
                timed_out = answer is MissionRawResult.TIMEOUT
                return (answer if timed_out else MissionRawResult.ERROR), []
            items.append(MissionItem(**{name: answer[name] for name in _ITEM}))
        self._send("MISSION_ACK", {"type": 0, "opaque_id": 0})
        none = MissionRawResult.NO_MISSION_AVAILABLE
        return (MissionRawResult.SUCCESS if items else none), items

    async def clear(self) -> MissionRawResult:
        """Delete everything on board."""
        result = await self._request("MISSION_CLEAR_ALL", {}, set())
        assert isinstance(result, MissionRawResult)  # noqa: S101 - nothing else was waited for
        return result

    async def _request(
        self, name: str, fields: dict[str, Any], names: set[str], wanted: Fields | None = None
    ) -> Fields | MissionRawResult:
        """Send until one of these comes with the wanted values; or how the transfer ended."""
        for _ in range(_TRANSFER_REPEATS + 1):
            self._send(name, fields)
            try:
                async with asyncio.timeout(_REPEAT_S):
                    while True:
                        named, answer = await self._inbox.get()
                        if named == "MISSION_REQUEST":  # PX4 before 1.17 begins with it
                            self._send("MISSION_ACK", {"type": _UNSUPPORTED, "opaque_id": 0})
                        if named == "MISSION_ACK":
                            return _ACKS.get(answer["type"], MissionRawResult.ERROR)
                        if named in names and answer.items() >= (wanted or {}).items():
                            return answer
            except TimeoutError:
                continue
        return MissionRawResult.TIMEOUT

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        target = {"target_system": self._link.system_id, "target_component": _AUTOPILOT}
        self._link.send(name, {**target, "mission_type": self._type, **fields})


class _Plugin:
    """A plugin: methods that answer by a callback, which gets the user's data last."""

    def __init__(self, link: StandIn) -> None:
        self._link = link

    def _answer(self, work: Any, callback: Callable[..., None]) -> None:
        async def answered() -> None:
            answer = await work
            callback(*(answer if isinstance(answer, tuple) else (answer,)), None)

        self._link.start(answered())


class _Direct(_Plugin):
    """`MavlinkDirect`."""

    def send_message(self, message: MavlinkMessage) -> None:
        self._link.send(message.message_name, _from_json(message.fields_json))

    def send_command_async(self, command: MavlinkMessage, callback: Callable[..., None]) -> None:
        async def work() -> tuple[MavlinkDirectResult, MavlinkMessage]:
            ack = await self._link.command(command.message_name, _from_json(command.fields_json))
            if ack is None:
                return MavlinkDirectResult.TIMEOUT, MavlinkMessage()
            return MavlinkDirectResult.SUCCESS, _message("COMMAND_ACK", ack, self._link.system_id)

        self._answer(work(), callback)

    def subscribe_message(
        self, name: str, callback: Callable[[MavlinkMessage, Any], None]
    ) -> Callable[[], None]:
        return self._link.listen_to_all(
            name, lambda fields, sender: callback(_message(name, fields, *sender), None)
        )


class _Raw(_Plugin):
    """`MissionRaw`, as far as it is used: one transfer for each of its methods."""

    def __init__(self, link: StandIn) -> None:
        super().__init__(link)
        self.upload_mission_async = partial(self._upload, _MISSION)
        self.upload_geofence_async = partial(self._upload, _FENCE)
        self.upload_rally_points_async = partial(self._upload, _RALLY)
        self.download_mission_async = partial(self._carry_out, _Transfer.download, _MISSION)
        self.download_geofence_async = partial(self._carry_out, _Transfer.download, _FENCE)
        self.download_rallypoints_async = partial(self._carry_out, _Transfer.download, _RALLY)
        self.clear_mission_async = partial(self._carry_out, _Transfer.clear, _MISSION)

    def _upload(self, kind: int, items: list[MissionItem], callback: Callable[..., None]) -> None:
        fields = [dict(vars(item)) for item in items]
        self._carry_out(lambda transfer: transfer.upload(fields), kind, callback)

    def _carry_out(
        self, work: Callable[[_Transfer], Any], kind: int, callback: Callable[..., None]
    ) -> None:
        self._answer(self._link.transfer(work, kind), callback)


class _Fence(_Plugin):
    """`Geofence`."""

    def clear_geofence_async(self, callback: Callable[..., None]) -> None:
        async def work() -> GeofenceResult:
            result = await self._link.transfer(_Transfer.clear, _FENCE)
            good = result == MissionRawResult.SUCCESS
            return GeofenceResult.SUCCESS if good else GeofenceResult.ERROR

        self._answer(work(), callback)


def _message(
    name: str, fields: Fields, system_id: int, component_id: int = _AUTOPILOT
) -> MavlinkMessage:
    plain = {
        key: value.rstrip(b"\0").decode() if key in _TEXTS else _plain(value)
        for key, value in fields.items()
    }
    return MavlinkMessage(name, system_id, component_id, 0, 0, json.dumps(plain))


def _plain(value: Any) -> Any:
    """As MAVSDK's JSON has it: what is not a number is nothing, bytes are numbers."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    return value


def _from_json(text: str) -> dict[str, Any]:
    """The way back; what is no number counts as not a number wherever a float can be."""
    return {k: math.nan if v is None else v for k, v in json.loads(text).items()}
