"""A seek policy: the robot that the vehicle reaches soonest comes first."""

from air_router.seek_policies import SearchPlace, SeekContext, TargetList


class Nearest:
    """Robots by the flight to them, group by group: free, lost, sought by another UAV."""

    foresees = False  # a robot's new path alone changes nothing here

    def order(self, targets: TargetList, context: SeekContext) -> list[SearchPlace]:
        """Every robot once, best first."""
        ordered: list[SearchPlace] = []
        for group in targets.groups(context.now_s):
            places = [self.place(robot, targets, context) for robot in group]
            ordered += sorted(places, key=lambda p: context.flight_s(p.position or context.unseen))
        return ordered

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """Where to look for one robot."""
        return targets.place(robot, context.now_s)
