"""The simulated flows of `python -m benchmarks.link.flows`."""

from benchmarks.link.flows import GROUPS, LINKS, Link, compared, measure


def test_a_run_gives_the_same_figures_every_time():
    link = Link(1.0, 0.1, 0.1)
    assert measure(link, 1) == measure(link, 1)


def test_a_known_link_is_used_better_than_an_unknown_one():
    figures = measure(Link(1.0, 0.3, 0.0), 0)
    assert figures["later, 1 s"] > 1.3 * figures["first, 1 s"] > 0
    assert figures["later, small"] > figures["first, small"]


def test_every_figure_is_compared():
    figures = {link.name: dict.fromkeys(measure(LINKS[0], 0), 1.0) for link in LINKS}
    lines = list(compared(figures, figures))
    assert len(lines) == len(GROUPS)
    assert all("+0.00%" in line for line in lines)
