"""sips-data: looks at data sets, measures their motion, fetches them. The only command that uses the network."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from tabulate import tabulate

from sips_lit.cli.arguments import path_argument
from sips_lit.cli.explain import explained
from sips_lit.cli.help import version_text
from sips_lit.dataset_tools.check import DataSetReport, SequenceReport, check, remarks
from sips_lit.dataset_tools.difficulty import CLASSES, TRAINING
from sips_lit.dataset_tools.download import Offer, fetch, read_catalogue, remote_size
from sips_lit.dataset_tools.recognise import DataSet, recognise
from sips_lit.dataset_tools.stats import GAPS, SequenceStats, draw_stats, sequence_stats
from sips_lit.dataset_tools.unpack import unpack
from sips_lit.errors import BadInputError
from sips_lit.pairs.build import build_indexes, unreadable_frames
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.progress import progress
from sips_lit.types import ImageSequence

PURPOSE = """\
Recognises data sets as they were downloaded, and says how to train on them; measures their motion.
Fetches data sets, too: the only command that uses the network.

  sips-data check kitti/
  sips-data stats my.mp4
  sips-data download"""
SHOWN = 30  # sequences and remarks that are printed of a data set


def check_command(args: argparse.Namespace) -> None:
    """Recognises, opens everything, reports. Raises BadInputError if something does not open."""
    whole = True
    for dataset in recognise(args.path):
        with progress(desc=f"opening {dataset.path.name}", unit="frame") as bar:
            report = check(dataset, bar.update)
        print(describe(report) + "\n")
        whole &= report.whole
    if not whole:
        raise BadInputError("some of the data does not open: see above")


def describe(report: DataSetReport) -> str:
    """A report in words: the data set, a table of its sequences, what to know, and how to use it."""
    dataset = report.dataset
    lines = [f"{dataset.path}: {dataset.spec.title} (known by {dataset.sign}), {report.bytes / 1e6:,.1f} MB"]
    if report.sequences:
        lines.append(table([sequence_row(s) for s in report.sequences[:SHOWN]]))
    if len(report.sequences) > SHOWN:
        frames = sum(s.frames for s in report.sequences)
        lines.append(f"... {len(report.sequences)} sequences in all, {frames} frames")
    said = remarks(report)
    lines += [f"- {remark}" for remark in said[:SHOWN]]
    if len(said) > SHOWN:
        lines.append(f"- and {len(said) - SHOWN} more remarks")
    if not report.problems:
        lines.append(how_to_use(dataset))
    return "\n".join(lines)


def table(rows: Sequence[Mapping[str, str]]) -> str:
    """Rows by column, as Markdown."""
    return tabulate(rows, headers="keys", tablefmt="pipe", disable_numparse=True)


def how_to_use(dataset: DataSet) -> str:
    """The command that trains on a data set, as it can be pasted into a shell."""
    spec = dataset.spec
    options = [f"data.{key}={_as_key(value)}" for key, value in dataset.options.items()]
    inliers = [] if "klt" in spec.inliers else [f"inliers={spec.inliers[0]}"]
    path = path_argument("data.path", dataset.path)
    return "use: " + shlex.join(["sips-train", f"data={spec.kind}", path, *options, *inliers, *spec.keys])


def _as_key(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def sequence_row(sequence: SequenceReport) -> dict[str, str]:
    """One line of the table."""
    sizes = [f"{w}x{h}" for (w, h), _ in sequence.sizes.most_common(2)]
    path = "" if sequence.path_metres is None else f"{sequence.path_metres:.2f} m, {sequence.turn_degrees:.1f} deg"
    return {
        "sequence": sequence.name,
        "frames": str(sequence.frames),
        "size": " ".join(sizes) + (" ..." if len(sequence.sizes) > 2 else ""),
        "frames/s": "" if sequence.rate is None else f"{sequence.rate:.1f}",
        "has": ", ".join(sequence.parts) or "images",
        "camera moves": path,
    }


def stats_command(args: argparse.Namespace) -> None:
    """Builds the overlap index where it is missing; prints a table and writes a picture.

    Raises BadInputError at the end if frames can't be read.
    """
    sequences: list[ImageSequence] = []
    for dataset in recognise(args.path):
        decoded = {"cache_dir": args.cache / "frames"} if dataset.spec.videos else {}
        sequences += dataset.sequences(**decoded)
    indexes = build_indexes(sequences, args.cache / "indexes", OverlapParameters(), args.workers)
    pairs = zip(sequences, indexes, strict=True)
    stats = [
        sequence_stats(s, i.read()) for s, i in progress(pairs, desc="motion", unit="sequence", total=len(sequences))
    ]
    print(
        f"{table([stats_row(s) for s in stats])}\n\n"
        "+n: median overlap with the frame n later; reach: median number of later frames with at least that overlap;\n"
        "pixels, metres, degrees: median motion to the next frame\n\n"
        f"{table([spread_row(s) for s in stats])}\n\n"
        f"pairs: of overlap >= {TRAINING:g}, as in training; then their shares by overlap, and of neighbouring frames;\n"
        "pixels, degrees, zoom: median / 90th percentile of the motion from one image of a pair to the other"
    )
    only = [s.name for s in stats if s.spread.only_neighbours]
    if only:
        print(
            f"\nalmost all pairs of {', '.join(only[:3])}{f' and {len(only) - 3} more' if len(only) > 3 else ''} are of "
            "neighbouring frames: nothing is seen from further away, so give frames at a higher rate, or of a slower camera"
        )
    args.output.parent.mkdir(parents=True, exist_ok=True)
    draw_stats(stats).savefig(args.output)
    print(f"\nwrote {args.output}")
    reasons = unreadable_frames(indexes)
    if reasons:
        raise BadInputError(f"frames can't be read and are left out ({len(reasons)}); the first: {reasons[0]}")


def stats_row(stats: SequenceStats) -> dict[str, str]:
    """Median overlap by the distance of frames, reach, and motion between neighbours."""
    motion = {"pixels": stats.pixels, "metres": stats.metres, "degrees": stats.degrees}
    return {
        "sequence": stats.name,
        "frames": str(stats.frames),
        **{f"+{gap}": "" if np.isnan(m) else f"{m:.2f}" for gap, m in zip(GAPS, stats.overlap[:, 1], strict=True)},
        f"reach {TRAINING:g}": f"{np.median(stats.reach_training):.0f}",
        "reach 0.5": f"{np.median(stats.reach_testing):.0f}",
        **{name: f"{np.median(values):.3g}" if len(values) else "" for name, values in motion.items()},
    }


def spread_row(stats: SequenceStats) -> dict[str, str]:
    """How the pairs of a sequence spread over overlap and motion."""
    spread = stats.spread
    known = spread.pairs > 0
    begins = [f"{begin:g}" for begin in (*CLASSES, 1)]
    shares = spread.classes / max(1, spread.pairs)
    motion = zip(("pixels", "degrees", "zoom"), spread.motion[:, [50, 90]], strict=True)
    return {
        "sequence": stats.name,
        "pairs": str(spread.pairs),
        **{f"{a} to {b}": f"{s:.0%}" if known else "" for a, b, s in zip(begins[:-1], begins[1:], shares, strict=True)},
        "neighbours": "" if np.isnan(spread.neighbours) else f"{spread.neighbours:.0%}",
        **{name: f"{middle:.3g} / {high:.3g}" if known else "" for name, (middle, high) in motion},
    }


def download_command(args: argparse.Namespace) -> None:
    """Says the size, and with --yes (or a yes on the terminal) fetches and unpacks."""
    offers = read_catalogue(args.catalogue) if args.catalogue else read_catalogue()
    if args.name is None:
        rows = [[o.name, f"{o.bytes / 1e9:.2f} GB", o.title, o.page] for o in offers.values()]
        print(tabulate(rows, headers=["name", "about", "what", "page (licence)"], tablefmt="pipe"))
    elif args.name not in offers:
        raise BadInputError(f"there is no data set {args.name} to download: choose among {', '.join(offers)}")
    else:
        download(offers[args.name], args.output, args.yes)


def download(offer: Offer, output: Path, yes: bool) -> None:
    """Fetches and unpacks an offer into ``output / name``. Raises BadInputError without a yes."""
    sizes = [remote_size(file.url) or file.bytes for file in offer.files]
    folder = output / offer.name
    print(f"{offer.title}\nlicence and terms: {offer.page}")
    print(f"to download: {sum(sizes) / 1e9:.2f} GB in {len(sizes)} file(s) to {folder.resolve()}")
    if not yes and not (sys.stdin.isatty() and input("go on? [y/N] ").strip().lower() in ("y", "yes")):
        raise BadInputError("nothing was downloaded: add --yes to go on")
    for file in offer.files:
        done = folder / f".{file.name}.unpacked"
        if done.exists():
            print(f"{file.name}: is there already")
            continue
        archive = fetch(file, folder)
        checked = "checksum verified" if file.sha256 else "no checksum is published: not verified"
        print(f"{file.name}: {checked}; {unpack(archive, folder)} files unpacked")
        done.touch()
        archive.unlink()
    for dataset in recognise(folder / offer.path):
        print(how_to_use(dataset))


def parser() -> argparse.ArgumentParser:
    """The command line."""
    top = argparse.ArgumentParser(
        prog="sips-data", description=PURPOSE, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    top.add_argument("--version", action="version", version=version_text("data"))
    commands = top.add_subparsers(required=True, metavar="check | stats | download")
    cache = Path(os.environ.get("SIPS_LIT_DATA", "data"))
    one = commands.add_parser("check", help="which data set a folder holds, and whether it is whole")
    one.add_argument("path", type=Path)
    one.set_defaults(task=check_command)
    two = commands.add_parser("stats", help="motion and overlap of its sequences, as a table and a picture")
    two.add_argument("path", type=Path)
    two.add_argument("--output", type=Path, default=Path("stats.png"), help="the picture (default: %(default)s)")
    two.add_argument(
        "--cache", type=Path, default=cache, help="where indexes and decoded videos go (default: %(default)s)"
    )
    two.add_argument("--workers", type=int, default=2, help="sequences measured side by side (default: %(default)s)")
    two.set_defaults(task=stats_command)
    three = commands.add_parser("download", help="fetches a data set; without a name: lists them")
    three.add_argument("name", nargs="?")
    three.add_argument("--yes", action="store_true", help="do not ask")
    three.add_argument("--output", type=Path, default=cache, help="folder to put it in (default: %(default)s)")
    three.add_argument("--catalogue", type=Path, help="another list of data sets (YAML, as in the package)")
    three.set_defaults(task=download_command)
    return top


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    args = parser().parse_args(arguments)
    with explained():
        args.task(args)
    sys.exit(0)


if __name__ == "__main__":
    main()
