"""The base station of a run: it stands at home, and tells whom it meets which goals it knows."""

from __future__ import annotations

from air_router.messages import POSE_TOPIC, PoseMessage
from sitl.experiment.events import EventQueue
from sitl.experiment.robots.messages import TARGETS_TOPIC, degrees, target_goals
from sitl.experiment.robots.node import EPOCH_S
from sitl.experiment.towns.town import Town


class BaseStation:
    """A station that does not move.

    Args:
        goals: Ids of the goals that it knows.

    Raises:
        ValueError: the town has no such goal.
    """

    def __init__(self, town: Town, goals: tuple[str, ...], queue: EventQueue) -> None:
        places = {goal.id: goal.position for goal in town.goals}
        for goal in goals:
            if goal not in places:
                raise ValueError(
                    f"base_goals: {town.name} has no goal '{goal}'; use {', '.join(places)}"
                )
        self.position = town.home
        self._queue = queue
        self._frame = town.frame
        self._goals = [places[goal] for goal in goals]
        self._told = False

    def say(self) -> list[tuple[str, bytes]]:
        """What it has to say to a peer that asks now."""
        stamp_s = EPOCH_S + self._queue.now_s
        latitude_deg, longitude_deg = degrees(self._frame, self.position)
        pose = PoseMessage(stamp_s=stamp_s, latitude_deg=latitude_deg, longitude_deg=longitude_deg)
        said = [(POSE_TOPIC, pose.encode())]
        if self._goals and not self._told:
            self._told = True
            said.append((TARGETS_TOPIC, target_goals(stamp_s, self._goals, self._frame)))
        return said
