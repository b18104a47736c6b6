"""A mission as map programs show it: features in degrees, GeoJSON and KML."""
