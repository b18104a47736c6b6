"""Files of a mission, read and written so that every value keeps its place in the file."""
