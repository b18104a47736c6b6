"""Results of the runs: tables, intervals, tests of claims, figures."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "figures": ("draw_all",),
        "report": ("Report", "differences", "fill", "text_of"),
        "statistics": ("student_t",),
    },
)
