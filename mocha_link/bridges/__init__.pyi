# What `mocha_link.bridges` gives, for type checkers; `__init__.py` has the module of each.

from mocha_link.bridges import run as run
from mocha_link.bridges.bridge import channel as channel
from mocha_link.bridges.dds import Dds as Dds
