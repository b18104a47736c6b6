"""A recorded flight as figures: what happened (`summary`), drawn (`charts`), on a page (`page`)."""
