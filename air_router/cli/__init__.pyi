# What `air_router.cli` gives, for type checkers; `__init__.py` says where it is.

from air_router.cli.arguments import ANY_FINITE as ANY_FINITE
from air_router.cli.arguments import MORE_THAN_0 as MORE_THAN_0
from air_router.cli.arguments import add_px4_version as add_px4_version
from air_router.cli.arguments import add_rover as add_rover
from air_router.cli.arguments import add_start as add_start
from air_router.cli.arguments import add_uav as add_uav
from air_router.cli.arguments import home as home
from air_router.cli.arguments import note_options as note_options
from air_router.cli.arguments import number as number
from air_router.cli.arguments import print_json as print_json
from air_router.cli.arguments import say as say
from air_router.cli.arguments import speed_factor as speed_factor
from air_router.cli.cli import program_of as program_of
from air_router.cli.fly import PART as PART
from air_router.cli.fly import add_flight_arguments as add_flight_arguments
from air_router.cli.fly import finish as finish
from air_router.cli.fly import fly_mission as fly_mission
from air_router.cli.fly import refusing as refusing
