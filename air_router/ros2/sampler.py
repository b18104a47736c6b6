"""How often each message of a flight is published: by the live bridge, and in a bag alike."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from air_router.ros2.messages import OutgoingMessage, Scene

POLL_S: Final = 0.2
"""Seconds between two polls: the vehicle's messages are published at each."""

SLOW_POLLS: Final = 5
"""Polls between two messages about what changes slowly."""

MAP_POLLS: Final = 5 * SLOW_POLLS
"""Of the map, which takes the flight's time: as often as robots are given it."""

Large = Callable[[str], Mapping[str, Any]]
"""The flight's view with its `areas` or its `map`."""


class Sampler:
    """Makes the messages of one flight, poll after poll.

    Args:
        scene: Makes each message.
        large: Requests what is large; only called when it has changed.
    """

    def __init__(self, scene: Scene, large: Large) -> None:
        self._scene, self._large = scene, large
        self._polls = 0  # large things are polled less often
        self._published: dict[str, int] = {}  # revisions published last, by what is large

    def messages(self, view: Mapping[str, Any], unix_s: float) -> Iterator[OutgoingMessage]:
        """The messages of the next poll.

        Args:
            view: The flight's newest.
            unix_s: The time of the messages.
        """
        yield from self._scene.vehicle(view, unix_s)
        self._polls += 1
        if self._polls % SLOW_POLLS != 1:
            return
        yield self._scene.team(view)
        yield self._scene.diagnostics(view, unix_s)
        if self._published.get("areas") != view["areas_revision"]:
            answer = self._large("areas")
            self._published["areas"] = answer["areas_revision"]
            yield self._scene.areas(answer["areas"])
        if self._polls % MAP_POLLS == 1 and self._published.get("map") != view["known_cells"]:
            answer = self._large("map")
            self._published["map"] = answer["known_cells"]
            yield self._scene.map(answer["map"], unix_s)
