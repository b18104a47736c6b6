"""Flies a PX4 vehicle around no-fly zones and decides from its links when to seek the robots."""

from mocha_link import __version__ as __version__
