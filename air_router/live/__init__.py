"""The map page of a flight that is under way."""
