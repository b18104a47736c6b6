"""The numbers of this room."""

FRESH_S = 30.0
"""A name that has addresses is resolved again after so long while it is used."""

RETRY_S = 1.0
"""After a failed resolution, or a failed contact, at the earliest."""

MAX_OF_NAME = 4
"""Addresses of one name, of one announcement, and of a peer that came from elsewhere."""

MAX_ANNOUNCEMENTS = 8
"""Announcements by mDNS of one robot that are kept, the newest: anyone can send them."""

MAX_TRIED = 6
"""Addresses of a peer that are tried in one contact."""

SEEN_S = 600.0
"""An address from which a peer came, or at which it was reached, is remembered for so long."""

CONFIRM_S = 10.0
"""After a change of our addresses, robots found by mDNS before are forgotten if they are not
announced again in this time: zeroconf queries four times in the first 7 s."""

MDNS_CLOSE_S = 0.3
"""How long the end of a node waits for its farewell by mDNS."""
