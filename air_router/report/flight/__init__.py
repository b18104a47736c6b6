"""A recorded flight as figures: what happened (`story`), drawn (`charts`), on a page (`page`)."""
