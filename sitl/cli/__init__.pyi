# What `sitl.cli` gives, for type checkers; `__init__.py` says where it is.

from sitl.cli.rehearse_command import fly as fly
