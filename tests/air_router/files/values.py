"""What is in plain data, for tests that change or look up any of it."""


def values_in(data, keys=()):
    """Key paths of all values, each with the value; the whole comes first."""
    yield keys, data
    items = data.items() if isinstance(data, dict) else ()
    for key, value in enumerate(data) if isinstance(data, list) else items:
        yield from values_in(value, (*keys, key))
