# What `air_router.controller.states` gives, for type checkers; `__init__.py` says where it is.

from air_router.controller.states.explore_state import Exploration as Exploration
from air_router.controller.states.goto_state import Accepted as Accepted
from air_router.controller.states.goto_state import GotoValidator as GotoValidator
from air_router.controller.states.limits import HOME_TOLERANCE_M as HOME_TOLERANCE_M
from air_router.controller.states.return_state import HomeReachability as HomeReachability
from air_router.controller.states.return_state import landing_radius_m as landing_radius_m
from air_router.controller.states.search_points import Search as Search
from air_router.controller.states.table import STATES as STATES
from air_router.controller.states.table import StateHandlers as StateHandlers
from air_router.controller.states.table import transitions as transitions
