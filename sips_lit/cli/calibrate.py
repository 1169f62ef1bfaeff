"""sips-calibrate: probabilities that come true on one's own data, checked on pairs held back, kept with the weights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
from omegaconf import DictConfig, OmegaConf
from tabulate import tabulate

from sips_lit.cli.app import build, run, typed
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.evaluation import make_pair_sets
from sips_lit.detect.checkpoint import export_safetensors, load_checkpoint, require_finite
from sips_lit.detect.covariance import scale_covariances
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.fit_recalibration import fit_recalibration
from sips_lit.detect.recalibration import AS_TRAINED, Recalibration
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.errors import BadInputError
from sips_lit.evaluate.method import Method, signature_of
from sips_lit.evaluate.recalibrate import (
    JudgedPair,
    Split,
    calibration_at,
    covariance_at,
    coverage_of,
    groups_of,
    judge_pairs,
    split_pairs,
)
from sips_lit.files import make_folder, write_csv, write_whole
from sips_lit.metrics.calibration import CalibrationResult
from sips_lit.metrics.coverage import Coverage
from sips_lit.render.figure import figure_to_array
from sips_lit.render.recalibration import draw_recalibration
from sips_lit.types import Descriptor


@dataclass
class CalibrateOptions:
    """Types of the keys of ``conf/calibrate.yaml`` that say what is written and what is fitted to."""

    checkpoint: str
    output: str | None
    overwrite: bool
    held_back: list[str]
    workers: int


@dataclass(frozen=True, slots=True)
class HeldBack:
    """A data set's pairs that nothing was fitted to, how they were chosen, and what was promised and came true."""

    title: str
    how: str
    pairs: Sequence[JudgedPair]
    k: int
    budgets: Sequence[int]

    def coverages(self, recalibration: Recalibration) -> list[Coverage]:
        """Coverage of budgets for k inliers."""
        return coverage_of(self.pairs, self.k, recalibration)


def calibrate(config: DictConfig) -> float:
    """Fits, writes and reports. Returns the mean, over data sets, of the calibration error after it."""
    options = typed(OmegaConf.create({key: config[key] for key in CalibrateOptions.__annotations__}), CalibrateOptions)
    network, selector = load_checkpoint(options.checkpoint)
    require_finite(network, options.checkpoint)
    output, folder = output_path(options), Path(config.paths.run)
    cv2.setNumThreads(-1)
    detector = SipsDetector(network, replace(selector, subpixel=True, recalibration=AS_TRAINED))
    fitted_to, held = measure_parts(config, options, detector, folder)
    recalibration = fit_recalibration(groups_of(fitted_to))
    rescaling = rescale(network, fitted_to, held)
    make_folder(output.parent)
    written = export_safetensors(network, replace(selector, recalibration=recalibration), output)
    print(f"\nfitted to {len(fitted_to)} pairs: {in_words(recalibration)}")
    written += report(held, recalibration, folder)
    print(rescaling, end="")
    print("\nwrote:\n" + "\n".join(f"  {file}" for file in written))
    errors = [calibration_at(one.pairs, n, recalibration).ece for one in held for n in one.budgets]
    return sum(errors) / len(errors)


def rescale(network: ScoreNetwork, fitted_to: Sequence[JudgedPair], held: Sequence[HeldBack]) -> str:
    """Multiplies the covariances of a network by the factor that residuals of the pairs ask for; what that did, in words.

    Nothing is done, nor said, where the network has no covariances or the pairs tell no residuals.
    """
    found = covariance_at(fitted_to)
    if found is None or not found.residuals:
        return ""
    scale_covariances(network, found.scale)
    lines = [f"\ncovariances are multiplied by {found.scale:.2f}; on pairs held back:"]
    for one in held:
        before, after = covariance_at(one.pairs), covariance_at(one.pairs, found.scale)
        if before is not None and after is not None:
            errors = f"error {before.error:.3f} before, {after.error:.3f} after"
            lines.append(f"  {one.title}: {errors}; needed factor {before.scale:.2f}, then {after.scale:.2f}")
    return "\n".join(lines) + "\n"


def output_path(options: CalibrateOptions) -> Path:
    """The file to write. Raises BadInputError for one that is there, or of another kind."""
    given = Path(options.checkpoint)
    path = given.with_name(f"{given.stem}_calibrated.safetensors") if options.output is None else Path(options.output)
    if path.suffix != ".safetensors":
        raise BadInputError(f"output is {path}: name a file that ends in .safetensors")
    for file in (path, path.with_suffix(".json")):
        if file.exists() and not options.overwrite:
            raise BadInputError(f"{file} is there already: name another file (output=...), or add overwrite=true")
    return path


def measure_parts(
    config: DictConfig, options: CalibrateOptions, detector: SipsDetector, folder: Path
) -> tuple[list[JudgedPair], list[HeldBack]]:
    """Pairs to fit to, of all data sets, and those held back, by data set.

    Raises BadInputError for names in ``held_back`` that no pair set has, and where nothing would be left on one side.
    """
    defaults = OmegaConf.load(CONF_DIR / "evaluation" / "default.yaml")
    whole = OmegaConf.merge(defaults, OmegaConf.create({"pose": False, "n": 1}), config)
    assert isinstance(whole, DictConfig)
    known = [str(key) for key, entry in (config.pair_sets or {}).items() if entry is not None]
    for name in options.held_back:
        if name not in known:
            raise BadInputError(
                f"held_back names {name}, which is no pair set: choose among {', '.join(known) or 'none'}"
            )
    if known and set(known) == set(options.held_back):
        raise BadInputError("held_back names every pair set: leave one to fit to")
    method = method_of(config, detector)
    fitted_to: list[JudgedPair] = []
    held: list[HeldBack] = []
    for pairs, measures in make_pair_sets(whole, folder):
        if pairs.key in options.held_back:
            split = Split((), tuple(range(len(pairs))), "all held back")
        else:
            split = split_pairs(pairs)
        if not split.held:
            raise BadInputError(f"{pairs.title} has a single pair: choose at least two, one to fit to and one to test")
        judged = judge_pairs(method, pairs, measures, Path(config.features), options.workers)
        fitted_to += [judged[at] for at in split.fit]
        of_set = [judged[at] for at in split.held]
        held.append(HeldBack(pairs.title, split.how, of_set, measures.k, measures.calibration))
    return fitted_to, held


def method_of(config: DictConfig, detector: SipsDetector) -> Method:
    """The network as it was trained, with the descriptor; raises BadInputError without one."""
    descriptor: Descriptor | None = build(config.descriptor)
    if descriptor is None:
        raise BadInputError("descriptor=own: the points have none of their own, choose descriptor=rootsift, say")
    made_of = detector.selector.config, OmegaConf.to_container(config.descriptor, resolve=True)
    return Method("sips_raw", detector.name, detector, descriptor, signature_of(detector, descriptor, *made_of))


def in_words(recalibration: Recalibration) -> str:
    """What it does to the logits."""
    r = recalibration
    shift = f" + {r.log_n:.3f} log(n / 50)" if r.log_n else ""
    return f"logit becomes {r.scale:.3f} logit {r.offset:+.3f}{shift}; difficulty of a pair {r.difficulty:.2f}"


def report(held: Sequence[HeldBack], recalibration: Recalibration, folder: Path) -> list[Path]:
    """Prints tables of the pairs held back, and writes them and a picture. Returns the files."""
    independent = replace(recalibration, difficulty=0.0)
    kinds = {"as trained": AS_TRAINED, "recalibrated, independent": independent, "recalibrated": recalibration}
    errors = [row for one in held for row in error_rows(one, recalibration)]
    covered = {one.title: {name: one.coverages(kind) for name, kind in kinds.items()} for one in held}
    for one in held:
        print(f"\n{one.title}: {one.how} ({len(one.pairs)} pairs)\n")
        head = ["points", "judged", "inliers", "mean p before", "after", "ECE before", "ECE after"]
        print(_table(head, [row[1:] for row in errors if row[0] == one.title]))
        print(f"\nbudgets for k = {one.k}, of the images of these pairs\n")
        print(_table(COVERAGE_HEAD, coverage_rows(covered[one.title])))
    files = [folder / "calibration.csv", folder / "coverage.csv", folder / "recalibration.png"]
    make_folder(folder)
    head = ["data", "points", "judged", "inlier_share", "mean_before", "mean_after", "ece_before", "ece_after"]
    write_csv(files[0], [head, *errors])
    rows = [[title, *row] for title, found in covered.items() for row in coverage_rows(found)]
    write_csv(files[1], [["data", *COVERAGE_HEAD], *rows])
    reliability = {one.title: _at_50(one, recalibration) for one in held}
    promises = {title: (found["as trained"], found["recalibrated"]) for title, found in covered.items()}
    picture = cv2.cvtColor(figure_to_array(draw_recalibration(reliability, promises)), cv2.COLOR_RGB2BGR)
    write_whole(files[2], cv2.imencode(".png", picture)[1].tobytes())
    return files


Cell = str | int | float | None


def _cells(*values: Cell) -> list[Cell]:
    """A row; what is not known, NaN, is no cell's value."""
    return [None if isinstance(value, float) and math.isnan(value) else value for value in values]


def error_rows(one: HeldBack, recalibration: Recalibration) -> list[list[Cell]]:
    """A row for each budget."""
    rows = []
    for n in one.budgets:
        before, after = calibration_at(one.pairs, n), calibration_at(one.pairs, n, recalibration)
        share, means, errors = before.share, (before.mean, after.mean), (before.ece, after.ece)
        rows.append(_cells(one.title, n, before.points, share, *means, *errors))
    return rows


COVERAGE_HEAD = ["points are", "asked", "observed", "images", "out of reach", "mean points", "best fixed n"]


def coverage_rows(found: Mapping[str, Sequence[Coverage]]) -> list[list[Cell]]:
    """A row for each probability that is asked for, with each way to see the points."""
    return [
        _cells(name, c.asked, c.observed, c.promised, c.out_of_reach, c.points, c.fixed)
        for name, each in found.items()
        for c in each
    ]


def _at_50(one: HeldBack, recalibration: Recalibration) -> tuple[CalibrationResult, CalibrationResult]:
    n = min(one.budgets, key=lambda budget: (abs(budget - 50), budget))
    return calibration_at(one.pairs, n), calibration_at(one.pairs, n, recalibration)


def _table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    return tabulate(rows, list(head), tablefmt="github", floatfmt=".3f", missingval="none")


main = partial(run, "calibrate", calibrate)

if __name__ == "__main__":
    main()
