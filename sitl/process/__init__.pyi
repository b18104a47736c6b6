# The names of `sitl.process`, for type checkers; `__init__.py` has the module of each.

from sitl.process.end_with_parent import ending_with_us as ending_with_us
from sitl.process.end_with_parent import stop_signal as stop_signal
from sitl.process.pace import Pace as Pace
from sitl.process.pace_link import FollowedPace as FollowedPace
from sitl.process.pace_link import PaceServer as PaceServer
from sitl.process.px4_install import ENVIRONMENT as ENVIRONMENT
from sitl.process.px4_install import IMAGE as IMAGE
from sitl.process.px4_install import Px4Install as Px4Install
from sitl.process.px4_install import find_px4 as find_px4
from sitl.process.px4_process import AIRFRAMES as AIRFRAMES
from sitl.process.px4_process import Px4Process as Px4Process
from sitl.process.px4_process import Px4Settings as Px4Settings
from sitl.process.vehicle import HERE as HERE
from sitl.process.vehicle import Address as Address
from sitl.process.vehicle import LinkAddresses as LinkAddresses
from sitl.process.vehicle import PortInUseError as PortInUseError
from sitl.process.vehicle import Ports as Ports
from sitl.process.vehicle import VehicleProcess as VehicleProcess
from sitl.process.vehicle import px4_ports as px4_ports
