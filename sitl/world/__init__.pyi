# The names of `sitl.world`, for type checkers; `__init__.py` has the module of each.

from sitl.world.air_to_ground import HIGHEST_M as HIGHEST_M
from sitl.world.air_to_ground import AirLoss as AirLoss
from sitl.world.air_to_ground import AirToGround as AirToGround
from sitl.world.ground_robots import Publication as Publication
from sitl.world.measured_link import MeasuredLink as MeasuredLink
from sitl.world.measured_link import air_loss as air_loss
from sitl.world.obstacles import Obstacles as Obstacles
from sitl.world.radio import RadioModel as RadioModel
from sitl.world.radio import TownRadio as TownRadio
from sitl.world.world import STEP_S as STEP_S
from sitl.world.world import Reading as Reading
from sitl.world.world import Step as Step
from sitl.world.world import Truth as Truth
from sitl.world.world import World as World
from sitl.world.world_file import WorldPlan as WorldPlan
from sitl.world.world_file import load_world as load_world
