# The names of `sitl.world.towns`, for type checkers; `__init__.py` has the module of each.

from sitl.world.towns.terrain import Camera as Camera
from sitl.world.towns.terrain import LandCover as LandCover
from sitl.world.towns.terrain import Raster as Raster
from sitl.world.towns.terrain import Road as Road
from sitl.world.towns.terrain import layers as layers
from sitl.world.towns.town import GRAIN_M as GRAIN_M
from sitl.world.towns.town import REACHED_M as REACHED_M
from sitl.world.towns.town import SAME_GOAL_M as SAME_GOAL_M
from sitl.world.towns.town import Cell as Cell
from sitl.world.towns.town import Lattice as Lattice
from sitl.world.towns.town import Town as Town
from sitl.world.towns.town import coarse as coarse
from sitl.world.towns.town_draws import drawn_starts as drawn_starts
from sitl.world.towns.town_draws import scatter as scatter
from sitl.world.towns.town_file import load_town as load_town
from sitl.world.towns.town_file import mission_over as mission_over
from sitl.world.towns.town_file import mission_text as mission_text
from sitl.world.towns.town_file import town_text as town_text
from sitl.world.towns.town_generator import generate as generate
from sitl.world.towns.ways import PASSABLE as PASSABLE
from sitl.world.towns.ways import Ways as Ways
from sitl.world.towns.ways import length_m as length_m
