# What `air_router.preflight` gives, for type checkers; `__init__.py` says where it is.

from air_router.preflight.card import BAD as BAD
from air_router.preflight.card import GOOD as GOOD
from air_router.preflight.card import LOOK as LOOK
from air_router.preflight.card import Card as Card
from air_router.preflight.card import Check as Check
from air_router.preflight.card import PreflightRefusedError as PreflightRefusedError
from air_router.preflight.check_facts import facts_of as facts_of
from air_router.preflight.check_facts import summary as summary
from air_router.preflight.preflight_survey import PreflightSurvey as PreflightSurvey
from air_router.preflight.survey import MissionSurvey as MissionSurvey
from air_router.preflight.survey import closest_approach as closest_approach
from air_router.preflight.survey import route_time_s as route_time_s
from air_router.preflight.world_check import WorldUncheckedError as WorldUncheckedError
from air_router.preflight.world_check import check_world as check_world
from air_router.preflight.world_check import world_notes as world_notes
