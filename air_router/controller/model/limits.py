"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For standing_alarms.py

ESCALATES_S: Final = 10.0
"""An alarm that is not answered for so long is repeated, and requests the sticks."""

REPEATED_S: Final = 30.0
"""And again so often, as long as it lasts: a pilot who flies by hand hears other things as well."""
