# The names of `sitl.world.explorers`, for type checkers; `__init__.py` has the module of each.

from sitl.world.explorers.exploration import Exploration as Exploration
from sitl.world.explorers.exploration import first_visits as first_visits
from sitl.world.explorers.explorer import NO_VEHICLE_M as NO_VEHICLE_M
from sitl.world.explorers.explorer import GroundRobot as GroundRobot
from sitl.world.explorers.explorer import Visit as Visit
from sitl.world.explorers.messages import CLAIMS_TOPIC as CLAIMS_TOPIC
from sitl.world.explorers.messages import OBJECTS_TOPIC as OBJECTS_TOPIC
from sitl.world.explorers.messages import POLICY_TOPIC as POLICY_TOPIC
from sitl.world.explorers.messages import REACHABILITY_TOPIC as REACHABILITY_TOPIC
from sitl.world.explorers.messages import degrees as degrees
from sitl.world.explorers.policies import Drive as Drive
from sitl.world.explorers.policies import Received as Received
from sitl.world.explorers.policies import RobotPolicy as RobotPolicy
from sitl.world.explorers.policies import RobotPolicyError as RobotPolicyError
from sitl.world.explorers.policies import RobotView as RobotView
from sitl.world.explorers.policies import check_choice as check_choice
from sitl.world.explorers.policies import robot_policy_of as robot_policy_of
from sitl.world.explorers.settings import ExplorerSettings as ExplorerSettings
from sitl.world.explorers.settings import PlacedBy as PlacedBy
from sitl.world.explorers.settings import Positive as Positive
