"""The simulated world as a process: its clock, its links that can be cut, its gossip nodes."""

from sitl.team.roles import TeamError, check_rovers, default_team, derive_team, make_world, roles_of
from sitl.team.team import Places, TeamSimulation

__all__ = [
    "Places",
    "TeamError",
    "TeamSimulation",
    "check_rovers",
    "default_team",
    "derive_team",
    "make_world",
    "roles_of",
]
