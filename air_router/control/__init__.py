"""Requests of the operator and of other programs: read, limited, served."""
