"""Pictures of missions, and what is reported of a flight that is over."""
