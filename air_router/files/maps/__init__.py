"""No-fly zones and missions in the formats of map programs and authorities."""
