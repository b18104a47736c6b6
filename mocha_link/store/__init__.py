"""Messages as they are kept: headers, bodies, the database, and its file."""
