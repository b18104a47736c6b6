"""No-fly zones in the formats of map programs and authorities."""
