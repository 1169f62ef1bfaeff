"""Draws from several threads at once."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from matplotlib._pylab_helpers import Gcf  # what pyplot keeps its figures in

Result = TypeVar("Result")


def in_threads(draw: Callable[[], Result], times: int = 8) -> list[Result]:
    """What ``draw`` gives when four threads call it; no figure may be left in pyplot."""
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: draw(), range(times)))
    assert Gcf.get_all_fig_managers() == []
    return results
