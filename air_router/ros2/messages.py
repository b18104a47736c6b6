"""The ROS 2 interface of a flight: standard messages, and types of services and actions.

Messages are made of the flight's answer to `view`. The frame `map` has its origin where the
mission's frame has it, x east, y north, z metres above home; `<uav>/base_link` is the vehicle in
it.

A request and its reply travel as rmw_cyclonedds has them: before the message stand the client and
the number of the request. Both are fields of the types here.
"""

import base64
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from air_router.gossip import MAP_FRAME, occupancy_of, stamp
from geo.frame import Geodetic, LocalFrame, Point
from geo.grid import SemanticGrid

Values = dict[str, Any]
"""A message as plain values; missing fields are zero or empty."""

PACKAGE: Final = "air_router_msgs"
GOTO: Final = f"{PACKAGE}/GoTo"
SEEK: Final = f"{PACKAGE}/Seek"
ALTITUDE: Final = f"{PACKAGE}/Altitude"
TRIGGER: Final = "std_srvs/Trigger"
CANCEL: Final = "action_msgs/CancelGoal"

FOLDER: Final = Path(__file__).parent / PACKAGE
"""A package for `colcon build`: other ROS programs need it to know the actions."""

HEADER: Final = ("client", "number")
"""The fields of `_REQUEST_ID`."""

_REQUEST_ID: Final = "uint64 client\nint64 number\n"
_GOAL_ID: Final = "unique_identifier_msgs/UUID goal_id\n"

_OK, _WARN, _ERROR, _STALE = range(4)
_SPHERES, _LINES, _STRIP, _TEXT, _SPHERE, _ARROW = 7, 5, 4, 9, 2, 0
_CLEAR: Final[Values] = {"action": 3}  # DELETEALL
_FENCE, _ZONE, _GRAPH, _PLACE, _ROBOT, _LINK = (
    (0.1, 0.4, 0.9),
    (0.85, 0.1, 0.1),
    (0.6, 0.6, 0.6),
    (0.2, 0.2, 0.2),
    (0.0, 0.6, 0.3),
    (0.9, 0.6, 0.0),
)


OutgoingMessage = tuple[str, Values]
"""The topic that a message is published on, and the message."""

TOPICS: Final[Mapping[str, str]] = {
    "~/state": "std_msgs/String",
    "~/fix": "sensor_msgs/NavSatFix",
    "~/pose": "geometry_msgs/PoseStamped",
    "~/battery": "sensor_msgs/BatteryState",
    "~/areas": "visualization_msgs/MarkerArray",
    "~/team": "visualization_msgs/MarkerArray",
    "~/map": "nav_msgs/OccupancyGrid",
    "/tf": "tf2_msgs/TFMessage",
    "/diagnostics": "diagnostic_msgs/DiagnosticArray",
}
"""The published topics and their types; a topic that begins with ``~/`` belongs to the vehicle."""


class Scene:
    """Makes the messages of one vehicle.

    Args:
        name: Of the vehicle, as ROS takes it.
        origin: Latitude and longitude of the mission's frame.
    """

    def __init__(self, name: str, origin: Sequence[float]) -> None:
        self._name = name
        self._frame = LocalFrame(Geodetic(*origin))

    def place(self, pair: Sequence[float]) -> Point:
        """Degrees as metres of the frame `map`."""
        return self._frame.to_local(*pair)

    def vehicle(self, view: Mapping[str, Any], unix_s: float) -> Iterator[OutgoingMessage]:
        """Where the vehicle is, and its battery; nothing before its first telemetry."""
        yield "~/state", {"data": view["state"]}
        if view["position"] is None:
            return
        header = {"stamp": stamp(unix_s), "frame_id": MAP_FRAME}
        body = f"{self._name}/base_link"
        at = self._xyz(view["position"], view["altitude_m"])
        heading_deg = view["heading_deg"]  # without one it looks east, the default of ROS
        turned = math.radians((90.0 - (90.0 if heading_deg is None else heading_deg)) / 2)
        rotation = {"z": math.sin(turned), "w": math.cos(turned)}
        yield "~/pose", {"header": header, "pose": {"position": at, "orientation": rotation}}
        transform = {"translation": at, "rotation": rotation}
        moved = {"header": header, "child_frame_id": body, "transform": transform}
        yield "/tf", {"transforms": [moved]}
        latitude_deg, longitude_deg = view["position"]
        own = {**header, "frame_id": body}
        place = {"latitude": latitude_deg, "longitude": longitude_deg}
        unknown_m = {"altitude": math.nan}  # above the ellipsoid: not known here
        yield "~/fix", {"header": own, "status": {"service": 1}, **place, **unknown_m}
        battery = view["battery"]
        unknown = ("voltage", "temperature", "current", "charge", "capacity", "design_capacity")
        yield (
            "~/battery",
            {
                "header": own,
                **dict.fromkeys(unknown, math.nan),
                "percentage": math.nan if battery is None else battery,
                "present": battery is not None,
            },
        )

    def team(self, view: Mapping[str, Any]) -> OutgoingMessage:
        """Last positions of robots, links with a signal, and the goal."""
        places = {robot: self._xyz(pair) for robot, pair in view["robots"].items()}
        markers = [
            marker
            for number, (robot, at) in enumerate(places.items())
            for marker in (
                _marker("robot", number, _SPHERE, _ROBOT, at=at, size_m=4.0),
                _marker("name", number, _TEXT, _ROBOT, at=at, size_m=5.0, text=robot),
            )
        ]
        if view["position"] is not None:
            here = self._xyz(view["position"], view["altitude_m"])
            linked = [link["peer"] for link in view["links"] if link["signal"] is not None]
            lines = [end for peer in linked if peer in places for end in (here, places[peer])]
            markers.append(_marker("link", 0, _LINES, _LINK, lines))
            if view["goal"] is not None:
                ends = [here, self._xyz(view["goal"], view["altitude_m"])]
                markers.append(_marker("goal", 0, _LINES, _FENCE, ends))
        return "~/team", {"markers": [_CLEAR, *markers]}

    def areas(self, areas: Mapping[str, Any]) -> OutgoingMessage:
        """Fences, zones, and the graph of waypoints."""
        markers = [_CLEAR]
        for area in areas["areas"]:
            rings = [ring for polygon in area["outline"] for ring in polygon]
            colour = _FENCE if area["fence"] else _ZONE
            for ring in rings:
                points = [self._xyz(pair) for pair in ring]
                markers.append(_marker(area["name"], len(markers), _STRIP, colour, points))
            if rings and not area["fence"]:
                at = self._xyz(rings[0][0])
                markers.append(
                    _marker(
                        "name", len(markers), _TEXT, colour, at=at, size_m=5.0, text=area["name"]
                    )
                )
        ways = [
            self._xyz(pair) for edge in areas["edges"] for leg in pairwise(edge) for pair in leg
        ]
        places = [self._xyz(place["at"]) for place in areas["places"]]
        markers.append(_marker("graph", 0, _LINES, _GRAPH, ways, size_m=0.3))
        markers.append(_marker("waypoints", 0, _SPHERES, _PLACE, places, size_m=3.0))
        return "~/areas", {"markers": markers}

    def map(self, packed: str, unix_s: float) -> OutgoingMessage:
        """The map that the vehicle has painted."""
        grid = SemanticGrid.decode(zlib.decompress(base64.b64decode(packed)))
        values, cells = occupancy_of(grid, unix_s)
        return "~/map", {**values, "data": cells}

    def diagnostics(self, view: Mapping[str, Any], unix_s: float) -> OutgoingMessage:
        """Mission and links, as rqt_robot_monitor and Foxglove show them."""
        level, message, waiting = _OK, view["state"], view.get("waiting")
        if view["walled_in"]:
            level, message = _ERROR, f"{message}: no way home"
        elif view.get("in_air") and not view["in_charge"]:
            level, message = _WARN, f"{message}: not under our commands"
        elif waiting is not None:
            level, message = _WARN, f"{message}: waiting: {waiting['why']}"
        keys = ("robot", "time_left_s", "points_left", "waypoints_left", "mode", "armed", "battery")
        facts = {key: view.get(key) for key in keys}
        facts["waiting"] = None if waiting is None else waiting["interlock"]
        statuses = [self._status("mission", level, message, facts)]
        for alarm in view.get("alarms", ()):
            text = f"{alarm['text']}. {alarm['instruction']}"
            statuses.append(self._status(f"alarm {alarm['about']}", _ERROR, text, {}))
        for link in view["links"]:
            level, message = _OK, link["signal"]
            if link["team_differs"]:
                level, message = _WARN, "another team file: only topics that both define alike"
            elif link["signal"] is None:
                level, message = _STALE, "the radio does not receive it"
            statuses.append(self._status(f"link {link['peer']}", level, message, link))
        return self._diagnostics(statuses, unix_s)

    def silent(self, why: str, unix_s: float) -> OutgoingMessage:
        """The flight does not answer."""
        return self._diagnostics([self._status("mission", _STALE, why, {})], unix_s)

    def _diagnostics(self, statuses: Sequence[Values], unix_s: float) -> OutgoingMessage:
        return "/diagnostics", {"header": {"stamp": stamp(unix_s)}, "status": list(statuses)}

    def _status(self, what: str, level: int, message: str, facts: Mapping[str, Any]) -> Values:
        return {
            "level": level,
            "name": f"{self._name}: {what}",
            "message": message,
            "hardware_id": self._name,
            "values": [{"key": key, "value": str(value)} for key, value in facts.items()],
        }

    def _xyz(self, pair: Sequence[float], up_m: float = 0.0) -> Values:
        place = self.place(pair)
        return {"x": place.east_m, "y": place.north_m, "z": up_m}


def _marker(  # noqa: PLR0913 - a marker has many sides
    group: str,
    number: int,
    kind: int,
    colour: tuple[float, float, float],
    points: Sequence[Values] = (),
    *,
    at: Values | None = None,
    size_m: float = 0.7,
    text: str = "",
) -> Values:
    """A marker in the frame `map`; without a stamp it is shown wherever the frame is now."""
    return {
        "header": {"frame_id": MAP_FRAME},
        "ns": group,
        "id": number,
        "type": kind,
        "pose": {"position": at or {}, "orientation": {"w": 1.0}},
        "scale": {"x": size_m, "y": size_m, "z": size_m},
        "color": {**dict(zip("rgb", colour, strict=True)), "a": 1.0},
        "points": list(points),
        "text": text,
    }


def definitions() -> dict[str, str]:
    """The texts of all types that are no standard ones, by ``package/Type``."""
    request, response = (FOLDER / "srv" / "Altitude.srv").read_text("utf-8").split("---\n")
    texts = {
        "geographic_msgs/GeoPoint": "float64 latitude\nfloat64 longitude\nfloat64 altitude\n",
        **_service(ALTITUDE, request, response),
        **_service(TRIGGER, "uint8 nothing\n", "bool success\nstring message\n"),
        **_service(
            CANCEL,
            "action_msgs/GoalInfo goal_info\n",
            "int8 return_code\naction_msgs/GoalInfo[] goals_canceling\n",
        ),
    }
    for action in (GOTO, SEEK):
        texts.update(_action(action))
    return texts


def spaces(texts: Mapping[str, str]) -> dict[str, str]:
    """Which of the types belong to services, and which to actions."""
    return {
        kind: "action" if kind.startswith((GOTO, SEEK)) else "srv"
        for kind in texts
        if kind.startswith(PACKAGE) or kind.endswith(("_Request", "_Response"))
    }


def _service(name: str, request: str, response: str) -> dict[str, str]:
    return {
        f"{name}_Request": _REQUEST_ID + request,
        f"{name}_Response": _REQUEST_ID + response,
    }


def _action(name: str) -> dict[str, str]:
    text = (FOLDER / "action" / f"{name.partition('/')[2]}.action").read_text("utf-8")
    goal, result, feedback = text.split("---\n")
    return {
        f"{name}_Goal": goal,
        f"{name}_Result": result,
        f"{name}_Feedback": feedback,
        f"{name}_FeedbackMessage": f"{_GOAL_ID}{name}_Feedback feedback\n",
        **_service(
            f"{name}_SendGoal",
            f"{_GOAL_ID}{name}_Goal goal\n",
            "bool accepted\nbuiltin_interfaces/Time stamp\n",
        ),
        **_service(f"{name}_GetResult", _GOAL_ID, f"int8 status\n{name}_Result result\n"),
    }
