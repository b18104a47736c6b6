# The names of `sitl.team`, for type checkers; `__init__.py` has the module of each.

from sitl.team.derived_team import derive_team as derive_team
from sitl.team.relay import RelayedPair as RelayedPair
from sitl.team.relay import relayed_pairs as relayed_pairs
from sitl.team.roles import TeamError as TeamError
from sitl.team.roles import TeamRoles as TeamRoles
from sitl.team.roles import check_rovers as check_rovers
from sitl.team.roles import default_team as default_team
from sitl.team.roles import roles_of as roles_of
from sitl.team.team import Places as Places
from sitl.team.team import TeamSimulation as TeamSimulation
from sitl.team.team_world import make_world as make_world
