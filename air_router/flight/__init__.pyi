# What `air_router.flight` gives, for type checkers; `__init__.py` says where it is.

from air_router.flight.flight import Flight as Flight
from air_router.flight.flight_loop import CommandService as CommandService
from air_router.flight.flight_stats import FlightResult as FlightResult
from air_router.flight.flight_stats import FlightStats as FlightStats
from air_router.flight.flight_stats import FlownTrack as FlownTrack
from air_router.flight.flight_view import FlightView as FlightView
from air_router.flight.flight_view import situation as situation
from air_router.flight.limits import COMMAND_S as COMMAND_S
from air_router.flight.resumption import as_begun as as_begun
from air_router.flight.terminal import StatusLine as StatusLine
from air_router.flight.terminal import line_of as line_of
