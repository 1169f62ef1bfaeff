"""The report as one page of HTML that needs nothing else: no network, no other file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.report.columns import OWN_N, best_first, columns_of
from sips_lit.report.counts import counts
from sips_lit.report.embedding import inline_svg, picture_uri
from sips_lit.report.figures import Styles, charts
from sips_lit.report.pair_pictures import PairPicture
from sips_lit.report.protocol import protocol_differences, protocol_rows, protocol_sentences, shared_protocol
from sips_lit.report.sortable_table import table_rows

PairPictures = Mapping[tuple[str, str], Sequence[PairPicture]]
"""By the keys of pair set and method."""
_TEMPLATES: Final = Environment(
    loader=PackageLoader("sips_lit.report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def report_page(
    results: Sequence[PairSetResult],
    pictures: PairPictures,
    styles: Styles,
    date: str | None,
    machine: Mapping[str, str],
) -> str:
    """The whole page; every text from outside is escaped. Raises BadInputError when a picture cannot be read."""
    columns = [column for result in results for column in columns_of(result.detectors)]
    return _TEMPLATES.get_template("page.html.j2").render(
        date=date,
        machine=protocol_rows(machine),
        sections=[_section(index, result, pictures, styles) for index, result in enumerate(results)],
        styles=styles,
        definitions=dict.fromkeys((column.title, column.definition) for column in columns),
        own_n=OWN_N,
    )


def _section(index: int, result: PairSetResult, pictures: PairPictures, styles: Styles) -> dict[str, Any]:
    """What the template shows of a pair set, as plain values."""
    methods, columns = result.detectors, columns_of(result.detectors)
    return {
        "title": result.title,
        "pairs": len(methods[0].pairs) if methods else 0,
        "columns": columns,
        "rows": table_rows(methods, columns),
        "skipped": result.skipped,
        "best_first": [method.name for method in best_first(methods)],
        "charts": [
            (chart, inline_svg(chart.figure, f"set-{index}-{chart.key}", chart.title))
            for chart in charts(result, styles, legend=False)
        ],
        "pictures": dict(_pictures(result.key, methods, pictures)),
        "counts": counts(result),
        "protocol": protocol_sentences(result),
        "protocol_rows": protocol_rows(shared_protocol(result)),
        "differences": protocol_differences(result),
    }


def _pictures(
    key: str, methods: Sequence[MethodResult], pictures: PairPictures
) -> Iterator[tuple[str, list[tuple[PairPicture, str]]]]:
    """The pictures of each method, by its name, with their data."""
    for method in methods:
        drawn = pictures.get((key, method.key), ())
        if drawn:
            yield method.name, [(picture, picture_uri(picture.image)) for picture in drawn]
