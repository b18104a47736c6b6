# What `mocha_link.cli` gives, for type checkers; `__init__.py` says where it is.

from mocha_link.cli.program import Command as Command
from mocha_link.cli.program import Program as Program
from mocha_link.cli.program import coloured as coloured
