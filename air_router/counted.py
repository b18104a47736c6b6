"""Numbers of things in words: one zone, two zones."""


def counted(count: int, things: str) -> str:
    """A count and what is counted; `things` is the plural, its first word to end in s loses it.

    `counted(1, "zones of the file")` is "1 zone of the file".
    """
    if count != 1:
        return f"{count} {things}"
    words = things.split(" ")
    place = next((i for i, word in enumerate(words) if word.endswith("s")), None)
    if place is not None:
        words[place] = words[place].removesuffix("s")
    return " ".join(("1", *words))
