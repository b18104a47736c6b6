# The names of `sitl.experiment.board`, for type checkers; `__init__.py` has the module of each.

from sitl.experiment.board.board import BASELINE as BASELINE
from sitl.experiment.board.board import Standing as Standing
from sitl.experiment.board.board import read_board as read_board
from sitl.experiment.board.board import standing as standing
from sitl.experiment.board.board import table_text as table_text
from sitl.experiment.board.board import write_board as write_board
from sitl.experiment.board.testset import FINGERPRINT as FINGERPRINT
from sitl.experiment.board.testset import NEVER as NEVER
from sitl.experiment.board.testset import TEST_SET as TEST_SET
from sitl.experiment.board.testset import ChangedSetError as ChangedSetError
from sitl.experiment.board.testset import entries as entries
from sitl.experiment.board.testset import frozen_set as frozen_set
