# What `mocha_link.cli` gives, for type checkers; `__init__.py` has the module of each.

from mocha_link.cli.program import PATH as PATH
from mocha_link.cli.program import Command as Command
from mocha_link.cli.program import Decorator as Decorator
from mocha_link.cli.program import Options as Options
from mocha_link.cli.program import Parsed as Parsed
from mocha_link.cli.program import Program as Program
from mocha_link.cli.program import coloured as coloured
from mocha_link.cli.program import command as command
from mocha_link.cli.program import option as option
from mocha_link.cli.program import optional as optional
from mocha_link.cli.program import options_of as options_of
from mocha_link.cli.program import together as together
