# What `air_router.controller` gives, for type checkers; `__init__.py` says where it is.

from air_router.controller.airspace_change import counted as counted
from air_router.controller.controller import Controller as Controller
from air_router.controller.flight_status import AirspaceStatus as AirspaceStatus
from air_router.controller.flight_status import FlightStatus as FlightStatus
from air_router.controller.flight_status import TargetStatus as TargetStatus
from air_router.controller.limits import LAG_HOLD_S as LAG_HOLD_S
from air_router.controller.limits import VEHICLE_SILENT_S as VEHICLE_SILENT_S
