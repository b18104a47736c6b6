"""A mission file's text, edited in place: everything else in it stays as it is."""
