"""A ground robot's policy: come back to the start when no map has arrived for a while."""

from air_router.messages import MAP_TOPIC
from sitl.robot_policies import Drive, RobotView

PATIENCE_S = 300.0


class ComesBack:
    """Waits where it started, which the UAV knows, until a new map arrives."""

    def choose(self, view: RobotView) -> Drive | None:
        """Where to drive; None: look for goals."""
        maps = [own.at_s for (_, topic), own in view.received.items() if topic == MAP_TOPIC]
        if view.now_s - max(maps, default=view.began_s) < PATIENCE_S:
            return None
        return Drive(view.start)
