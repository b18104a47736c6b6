# The names of `sitl.cli`, for type checkers; `__init__.py` has the module of each.

from sitl.cli.rehearse_command import fly as fly
