# The names of `sitl.experiment.learning`, for type checkers; `__init__.py` has the module of each.

from sitl.experiment.learning.decisions import Decision as Decision
from sitl.experiment.learning.decisions import DecisionRun as DecisionRun
from sitl.experiment.learning.environment import SeekEnvironment as SeekEnvironment
from sitl.experiment.learning.environment import environment_of as environment_of
