"""The pure world around a mission: without a clock, sockets or nodes."""

from collections.abc import Collection

from air_router.gossip import RESOLUTION_M
from air_router.mission import Mission
from mocha_link.team import Team
from sitl.team.nodes import RosMessages
from sitl.team.roles import TeamRoles
from sitl.world import World, WorldPlan
from sitl.world.towns import Raster


def make_world(
    mission: Mission,
    team: Team,
    roles: TeamRoles,
    plan: WorldPlan,
    played: Collection[str] = (),
) -> World:
    """The pure world of a mission: robots where they start.

    Those that are `played` by programs stand there, and publish nothing by themselves.
    """
    corners = [corner for fence in mission.fences for corner in fence.corners]
    corners += [*(waypoint.position for waypoint in mission.waypoints), mission.home]
    raster = Raster.draw(plan.land_cover, corners, RESOLUTION_M, plan.margin_m)
    ros_messages = RosMessages(team)
    topics = {name: () if name in played else ros_messages.topics(name) for name in roles.ground}
    world = World(plan, mission.frame, roles.vehicles, raster, topics)
    for name in played:
        world.stand(name, world.robots[name].position)
    return world
