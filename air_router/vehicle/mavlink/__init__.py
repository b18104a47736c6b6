"""The MAVLink link: MAVSDK made awaitable, the peer, and the search for one."""
