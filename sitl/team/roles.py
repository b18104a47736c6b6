"""Who is who in a team that flies a mission, and the pure world around it."""

from collections.abc import Collection
from dataclasses import dataclass

from air_router.errors import AirRouterError, ExitCode
from air_router.gossip.mapper import RESOLUTION_M
from air_router.mission.mission import Mission
from air_router.mission.team import UAV_KIND
from mocha_link.team.team import Team
from sitl.team.nodes import RosMessages
from sitl.world.terrain import Raster
from sitl.world.ugv import GroundRobot
from sitl.world.world import Settings, World
from sitl.world.world_file import WorldPlan


class TeamError(AirRouterError):
    """The team does not fit the mission; the message says how."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class TeamRoles:
    """Who is who in a team: the vehicles that fly the mission, and the robots on the ground.

    The first vehicle is the one whose clock is the world's.
    """

    vehicles: tuple[str, ...]
    ground: tuple[str, ...]


def roles_of(mission: Mission, team: Team) -> TeamRoles:
    """Who flies and who drives. Aerial robots that the mission is not for are not simulated.

    Raises:
        TeamError: it is not clear who flies, or no robot drives.
    """
    flying = [name for name, robot in team.robots.items() if robot.kind == UAV_KIND]
    vehicle = mission.uav
    if vehicle is None and len(flying) == 1:
        vehicle = flying[0]
    if vehicle is None or vehicle not in team.robots:
        raise TeamError(
            f"{team.path}: which robot flies this mission? set 'uav' in the mission to one of "
            f"{', '.join(team.robots)}"
        )
    ground = tuple(name for name in team.robots if name != vehicle and name not in flying)
    if not ground:
        raise TeamError(f"{team.path}: no robot drives on the ground; add a robot of another kind")
    others = (layer.uav for layer in mission.layers if layer.uav != vehicle)
    return TeamRoles((vehicle, *others), ground)


def make_world(
    mission: Mission,
    team: Team,
    roles: TeamRoles,
    plan: WorldPlan,
    played: Collection[str] = (),
) -> World:
    """The pure world of a mission: robots at the start of their patrols.

    Those that are `played` by programs stand there, and say nothing by themselves.
    """
    corners = [corner for fence in mission.fences for corner in fence.corners]
    corners += [*(waypoint.position for waypoint in mission.waypoints), mission.home]
    settings = Settings(
        frame=mission.frame,
        vehicles=roles.vehicles,
        radio=plan.radio,
        air=plan.air,
        camera=plan.camera,
        raster=Raster.draw(plan.scene, corners, RESOLUTION_M, plan.margin_m),
        camera_interval_s=plan.picture_interval_s,
        reading_interval_s=plan.reading_interval_s,
    )
    robots = {
        name: GroundRobot(name, p.patrol, p.speed_m_s, plan.scene.vehicles, p.start_m)
        for name, p in plan.patrols.items()
    }
    speech = RosMessages(team)
    topics = {name: () if name in played else speech.topics(name) for name in robots}
    for name in played:
        robots[name].stand(robots[name].position)
    return World(settings, robots, topics)
