"""The report as one page of HTML that needs nothing else: no network, no other file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import best_first
from sips_lit.report.counts_html import defects_html, without_pose_html
from sips_lit.report.embedding import inline_svg, picture_uri
from sips_lit.report.figures import Styles, charts
from sips_lit.report.glossary import glossary_html
from sips_lit.report.pair_pictures import PairPicture
from sips_lit.report.protocol_html import definition_table, protocol_html
from sips_lit.report.table_html import swatch, table_html

_FEW = 6


def report_page(
    results: Sequence[PairSetResult],
    pictures: Mapping[tuple[str, str], Sequence[PairPicture]],
    styles: Styles,
    date: str | None,
    machine: Mapping[str, str],
) -> str:
    """The whole page; every text from outside is escaped. Raises BadInputError when a picture cannot be read."""
    links = "".join(f'<a href="#set-{index}">{escape(result.title)}</a>' for index, result in enumerate(results))
    sections = "\n".join(_section(index, result, pictures, styles) for index, result in enumerate(results))
    dated = f'<p class="soft">{escape(date)}</p>' if date else ""
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Benchmark of interest points</title>
<style>
{_part("page.css")}</style>
</head>
<body>
<h1>Benchmark of interest points</h1>
{dated}
<nav>{links}<a href="#glossary">Definitions</a><a href="#machine">Machine</a></nav>
{sections or "<p>There are no pair sets.</p>"}
<section id="glossary"><h2>Definitions</h2>
{glossary_html(results)}
</section>
<section id="machine"><h2>Machine</h2>
<p>Times are of this machine; all other numbers do not depend on it, but for rounding.</p>
{definition_table(machine)}
</section>
<script>
{_part("page.js")}</script>
</body>
</html>
"""


def _part(name: str) -> str:
    return (files(__package__) / name).read_text(encoding="utf-8")


def _section(
    index: int, result: PairSetResult, pictures: Mapping[tuple[str, str], Sequence[PairPicture]], styles: Styles
) -> str:
    parts = [f'<section id="set-{index}"><h2>{escape(result.title)}</h2>']
    if result.detectors:
        pairs = len(result.detectors[0].pairs)
        parts.append(
            f'<p class="soft">{pairs} {"pair" if pairs == 1 else "pairs"} of images. A click on a heading sorts.</p>'
        )
        parts.append(table_html(result, styles))
    else:
        parts.append("<p>No detector could be run on this pair set.</p>")
    parts += [_skipped(result), _charts(index, result, styles), _pictures(result, pictures)]
    parts += [defects_html(result), without_pose_html(result)]
    parts.append(f"<h3>Protocol</h3>\n{protocol_html(result)}")
    return "\n".join([*filter(None, parts), "</section>"])


def _skipped(result: PairSetResult) -> str:
    if not result.skipped:
        return ""
    lines = "".join(f"<li><b>{escape(key)}</b>: {escape(reason)}</li>" for key, reason in result.skipped.items())
    return f"<h3>Skipped</h3>\n<ul>{lines}</ul>"


def _charts(index: int, result: PairSetResult, styles: Styles) -> str:
    blocks = [
        f"<figure{' class=wide' if chart.wide else ''}><h4>{escape(chart.title)}</h4>"
        f"{inline_svg(chart.figure, f'set-{index}-{chart.key}', escape(chart.title))}"
        f"<figcaption>{escape(chart.caption)}</figcaption></figure>"
        for chart in charts(result, styles, legend=False)
    ]
    if not blocks:
        return ""
    return f'<h3>Curves</h3>\n{_ticks(result, styles)}\n<div class="charts">\n' + "\n".join(blocks) + "\n</div>"


def _ticks(result: PairSetResult, styles: Styles) -> str:
    """A tick for each detector, best AUC first: the legend of all charts."""
    names = [method.name for method in best_first(result.detectors)]
    boxes = "".join(
        f'<label><input type="checkbox" checked data-curve="{styles[name].index}"> '
        f"{swatch(styles[name])}{escape(name)}</label>"
        for name in names
    )
    choices = {"all": len(names), "none": 0} | ({f"best {_FEW}": _FEW} if len(names) > _FEW else {})
    buttons = [f'<button type="button" data-show="{shown}">{word}</button>' for word, shown in choices.items()]
    return f"<fieldset><legend>Show {' · '.join(buttons)}</legend>{boxes}</fieldset>"


def _pictures(result: PairSetResult, pictures: Mapping[tuple[str, str], Sequence[PairPicture]]) -> str:
    blocks = []
    for detector in result.detectors:
        drawn = pictures.get((result.key, detector.key), ())
        figures = "".join(
            f'<figure><img loading="lazy" src="{picture_uri(p.image)}" '
            f'alt="{escape(p.label)} pair of {escape(detector.name)}">'
            f"<figcaption><b>{escape(p.label)}</b>: {escape(p.caption)}</figcaption></figure>"
            for p in drawn
        )
        if figures:
            blocks.append(
                f'<details><summary>{escape(detector.name)}</summary><div class="pictures">{figures}</div></details>'
            )
    if not blocks:
        return ""
    return "<h3>Best, median and worst pair of each detector</h3>\n" + "\n".join(blocks)
