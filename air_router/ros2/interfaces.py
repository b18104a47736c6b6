"""ROS 2 types that are no standard messages: services, actions, and what they are made of.

A request and its reply travel as rmw_cyclonedds has them: before the message stands who asks, and
the number of the request. Both are fields of the types here.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

PACKAGE: Final = "air_router_msgs"
GOTO: Final = f"{PACKAGE}/GoTo"
SEEK: Final = f"{PACKAGE}/Seek"
TRIGGER: Final = "std_srvs/Trigger"
CANCEL: Final = "action_msgs/CancelGoal"

FOLDER: Final = Path(__file__).parent / PACKAGE
"""A package for `colcon build`: other ROS programs need it to know the actions."""

HEADER: Final = ("client", "number")
"""The fields of `_ASKED`."""

_ASKED: Final = "uint64 client\nint64 number\n"
_GOAL_ID: Final = "unique_identifier_msgs/UUID goal_id\n"


def definitions() -> dict[str, str]:
    """The texts of all types that are no standard ones, by ``package/Type``."""
    texts = {
        "geographic_msgs/GeoPoint": "float64 latitude\nfloat64 longitude\nfloat64 altitude\n",
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
        kind: "action" if kind.startswith(PACKAGE) else "srv"
        for kind in texts
        if kind.startswith(PACKAGE) or kind.endswith(("_Request", "_Response"))
    }


def _service(name: str, request: str, response: str) -> dict[str, str]:
    return {f"{name}_Request": _ASKED + request, f"{name}_Response": _ASKED + response}


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
