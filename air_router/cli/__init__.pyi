# What `air_router.cli` gives, for type checkers; `__init__.py` says where it is.

from air_router.cli.arguments import ANY_FINITE as ANY_FINITE
from air_router.cli.arguments import MORE_THAN_0 as MORE_THAN_0
from air_router.cli.arguments import home as home
from air_router.cli.arguments import note_options as note_options
from air_router.cli.arguments import number as number
from air_router.cli.arguments import print_json as print_json
from air_router.cli.arguments import px4_version_option as px4_version_option
from air_router.cli.arguments import rover_option as rover_option
from air_router.cli.arguments import say as say
from air_router.cli.arguments import speed_factor as speed_factor
from air_router.cli.arguments import start_option as start_option
from air_router.cli.arguments import uav_option as uav_option
from air_router.cli.cli import program_of as program_of
from air_router.cli.fly import PART as PART
from air_router.cli.fly import finish as finish
from air_router.cli.fly import flight_options as flight_options
from air_router.cli.fly import fly_mission as fly_mission
from air_router.cli.fly import refusing as refusing
