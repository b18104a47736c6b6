"""Steps about missions, fences and rally points."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

from sitl.conformance.expectations import same
from sitl.conformance.talk import DepartureError, Heard, Talk
from sitl.px4sim.plan.mission_items import MissionResult

_PATIENCE_S: Final = 3.0
_ANSWERS: Final = ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")


@dataclass(frozen=True)
class Item:
    """One item of a plan.

    Attributes:
        command: MAV_CMD.
        north_m: Local metres.
        east_m: Local metres.
        z_m: Above home in the relative frames.
        frame: MAV_FRAME.
        params: param1 to param4.
        autocontinue: Whether the mission goes on by itself.
        latitude_deg: Instead of north.
        raw: x and y as they are.
        current: Whether it is marked as the current one.
    """

    command: int = 16
    north_m: float = 0.0
    east_m: float = 0.0
    z_m: float = 15.0
    frame: int = 6
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, math.nan)
    autocontinue: bool = True
    latitude_deg: float | None = None
    raw: tuple[int, int] | None = None
    current: bool = False

    def fields(self, talk: Talk, sequence: int, mission_type: int) -> dict[str, Any]:
        """Fields of MISSION_ITEM_INT."""
        latitude, longitude = talk.degrees(self.north_m, self.east_m)
        if self.latitude_deg is not None:
            latitude = self.latitude_deg
        x, y = self.raw or (round(latitude * 1e7), round(longitude * 1e7))
        param1, param2, param3, param4 = self.params
        return {
            "target_system": talk.vehicle_id,
            "target_component": 1,
            "seq": sequence,
            "frame": self.frame,
            "command": self.command,
            "current": int(self.current),
            "autocontinue": int(self.autocontinue),
            "x": x,
            "y": y,
            "z": self.z_m,
            "param1": param1,
            "param2": param2,
            "param3": param3,
            "param4": param4,
            "mission_type": mission_type,
        }


def waypoint(north_m: float, east_m: float = 0.0, up_m: float = 15.0, **changes: Any) -> Item:
    """A NAV_WAYPOINT that the mission does not wait at."""
    return Item(16, north_m, east_m, up_m, **changes)


def polygon(
    *corners: tuple[float, float], inclusion: bool = False, **changes: Any
) -> tuple[Item, ...]:
    """A fence polygon of corners north, east."""
    command = 5001 if inclusion else 5002
    params = changes.pop("params", (float(len(corners)), 0.0, 0.0, 0.0))
    frame = changes.pop("frame", 0)
    return tuple(
        Item(command, north, east, 0.0, frame=frame, params=params, **changes)
        for north, east in corners
    )


def box(north_m: float, east_m: float, half_m: float, **changes: Any) -> tuple[Item, ...]:
    """A square fence polygon around a place."""
    return polygon(
        (north_m - half_m, east_m - half_m),
        (north_m - half_m, east_m + half_m),
        (north_m + half_m, east_m + half_m),
        (north_m + half_m, east_m - half_m),
        **changes,
    )


@dataclass(frozen=True)
class Upload:
    """MISSION_COUNT, the items as they are asked for, and the result that MISSION_ACK gives.

    Attributes:
        items: The plan.
        mission_type: MAV_MISSION_TYPE.
        result: Name of MAV_MISSION_RESULT.
        refused_at: The item after which the upload ends; None: after all; -1: at the count.
        as_float: Send MISSION_ITEM instead of MISSION_ITEM_INT.
    """

    items: tuple[Item, ...]
    mission_type: int = 0
    result: str = "ACCEPTED"
    refused_at: int | None = None
    as_float: bool = False

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        expected = len(self.items) if self.refused_at is None else self.refused_at + 1
        talk.mark()
        kind: dict[str, Any] = {"mission_type": self.mission_type}
        talk.say("MISSION_COUNT", **talk.target, **kind, count=len(self.items))
        sent = 0
        while True:
            answer = _next_answer(talk, _ANSWERS)
            if answer is None:
                raise DepartureError(f"the upload got stuck after {sent} items: no answer")
            fields = answer.fields
            if answer.frame.name == "MISSION_ACK":
                result = MissionResult(fields["type"]).name
                talk.notes.append(f"upload of {len(self.items)}: {result} after {sent}")
                if (result, sent) != (self.result, expected):
                    raise DepartureError(
                        f"expected MISSION_ACK {self.result} after {expected} items, "
                        f"heard {result} after {sent}"
                    )
                return
            item = self.items[fields["seq"]].fields(talk, fields["seq"], self.mission_type)
            sent = fields["seq"] + 1
            name = "MISSION_ITEM_INT"
            if self.as_float:
                name = "MISSION_ITEM"
                item |= {"x": item["x"] * 1e-7, "y": item["y"] * 1e-7}
            talk.mark()
            talk.say(name, **item)


@dataclass(frozen=True)
class Download:
    """MISSION_REQUEST_LIST and every item; what of them comes back.

    Attributes:
        items: Fields that each item is to have, in order.
        mission_type: MAV_MISSION_TYPE.
        finished: Whether the last MISSION_ACK is sent: without it PX4 waits for five seconds.
        as_float: Ask with MISSION_REQUEST.
    """

    items: tuple[dict[str, Any], ...]
    mission_type: int = 0
    finished: bool = True
    as_float: bool = False

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        kind: dict[str, Any] = {"mission_type": self.mission_type}
        talk.mark()
        talk.say("MISSION_REQUEST_LIST", **talk.target, **kind)
        count = _next_answer(talk, ("MISSION_COUNT",))
        if count is None or count.fields["count"] != len(self.items):
            heard = None if count is None else count.fields["count"]
            raise DepartureError(f"expected MISSION_COUNT {len(self.items)}, heard {heard}")
        request, reply = (
            ("MISSION_REQUEST", "MISSION_ITEM")
            if self.as_float
            else ("MISSION_REQUEST_INT", "MISSION_ITEM_INT")
        )
        for sequence, wanted in enumerate(self.items):
            talk.mark()
            talk.say(request, **talk.target, **kind, seq=sequence)
            item = _next_answer(talk, (reply, "MISSION_ACK"))
            if item is None or item.frame.name != reply or not same(item.fields, wanted):
                got = None if item is None else {k: item.fields.get(k) for k in wanted}
                raise DepartureError(f"expected item {sequence} {wanted}, heard {got}")
        if self.finished:
            talk.say("MISSION_ACK", **talk.target, **kind, type=0)


@dataclass(frozen=True)
class Mission:
    """MISSION_CURRENT as it is to become within some seconds.

    Attributes:
        fields: Values: seq, total, mission_state (1 none, 2 not started, 3 active, 4 paused, 5
            complete), mission_mode (1 active, 2 suspended), mission_id, fence_id.
        within_s: How long to wait.
    """

    fields: dict[str, Any] = field(default_factory=dict)
    within_s: float = 2.5

    def play(self, talk: Talk) -> None:
        """See `Step`: only what comes from now on counts."""
        since_s = talk.now_s

        def shown() -> bool:
            return any(
                heard.at_s >= since_s and same(heard.fields, self.fields)
                for heard in talk.since("MISSION_CURRENT")
            )

        if not talk.run(self.within_s, shown):
            raise DepartureError(
                f"expected MISSION_CURRENT {self.fields}, it is {talk.newest('MISSION_CURRENT')}"
            )


@dataclass(frozen=True)
class SetCurrent:
    """MISSION_SET_CURRENT: no answer is expected, only MISSION_CURRENT shows it."""

    sequence: int

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        talk.mark()
        talk.say("MISSION_SET_CURRENT", **talk.target, seq=self.sequence)


@dataclass(frozen=True)
class ClearAll:
    """MISSION_CLEAR_ALL, and its MISSION_ACK."""

    mission_type: int = 0

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        talk.mark()
        talk.say("MISSION_CLEAR_ALL", **talk.target, mission_type=self.mission_type)
        answer = _next_answer(talk, ("MISSION_ACK",))
        if answer is None or answer.fields["type"] != MissionResult.ACCEPTED:
            heard = None if answer is None else answer.fields["type"]
            raise DepartureError(f"expected MISSION_ACK ACCEPTED, heard {heard}")


@dataclass(frozen=True)
class Requests:
    """How a vehicle repeats its request while nobody sends the item.

    Attributes:
        sequence: The item that it asks for.
        name: MISSION_REQUEST_INT, or MISSION_REQUEST after a MISSION_ITEM.
        for_s: How long to listen.
        fewest: Requests, at least.
        most: Requests, at most.
    """

    sequence: int
    for_s: float
    fewest: int
    most: int
    name: str = "MISSION_REQUEST_INT"

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        talk.run(self.for_s)
        count = sum(heard.fields["seq"] == self.sequence for heard in talk.since(self.name))
        talk.notes.append(f"{count} x {self.name} {self.sequence} in {self.for_s:g} s")
        if not self.fewest <= count <= self.most:
            raise DepartureError(
                f"expected {self.fewest} to {self.most} {self.name} in {self.for_s:g} s, "
                f"heard {count}"
            )


def _next_answer(talk: Talk, names: tuple[str, ...]) -> Heard | None:
    answers: list[Heard] = []

    def come() -> bool:
        answers[:] = [heard for name in names for heard in talk.since(name)]
        return bool(answers)

    return min(answers, key=lambda heard: heard.at_s) if talk.run(_PATIENCE_S, come) else None
