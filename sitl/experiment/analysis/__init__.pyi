# The names of `sitl.experiment.analysis`, for type checkers; `__init__.py` has the module of each.

from sitl.experiment.analysis.figures import draw_all as draw_all
from sitl.experiment.analysis.report import Report as Report
from sitl.experiment.analysis.report import differences as differences
from sitl.experiment.analysis.report import fill as fill
from sitl.experiment.analysis.report import text_of as text_of
from sitl.experiment.analysis.statistics import student_t as student_t
