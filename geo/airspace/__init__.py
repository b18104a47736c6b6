"""Where a vehicle may be: fences, zones, and the distance kept from them."""
