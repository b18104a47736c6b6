# What `air_router.controller.motion` gives, for type checkers; `__init__.py` says where it is.

from air_router.controller.motion.command_gate import CommandGate as CommandGate
from air_router.controller.motion.initial_climb import ClimbWatch as ClimbWatch
from air_router.controller.motion.initial_climb import InitialClimb as InitialClimb
from air_router.controller.motion.initial_climb import below as below
from air_router.controller.motion.interlocks import INTERLOCKS as INTERLOCKS
from air_router.controller.motion.interlocks import Blocked as Blocked
from air_router.controller.motion.interlocks import Interlock as Interlock
from air_router.controller.motion.interlocks import MotionOutcome as MotionOutcome
from air_router.controller.motion.interlocks import raised as raised
from air_router.controller.motion.limits import ALTITUDE_M as ALTITUDE_M
from air_router.controller.motion.limits import REACTION_S as REACTION_S
from air_router.controller.motion.limits import RETRY_S as RETRY_S
from air_router.controller.motion.navigator import Navigator as Navigator
from air_router.controller.motion.setpoints import MODES as MODES
from air_router.controller.motion.setpoints import stopping_point as stopping_point
from air_router.controller.motion.way_out import nearest_way_out as nearest_way_out
