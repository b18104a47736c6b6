"""Whether mission, vehicle and battery are fit for the flight, before it begins."""
