"""sips-odometry: the trajectory of a camera from n points a frame, and what the number of points is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import cv2
from omegaconf import DictConfig, ListConfig, OmegaConf

from sips_lit.cli.app import build, run, typed
from sips_lit.cli.evaluation import tell_written, told
from sips_lit.cli.methods import configured_method, make_methods
from sips_lit.cli.next_steps import after_odometry
from sips_lit.detect.sanitise import Defects
from sips_lit.errors import BadInputError
from sips_lit.frames.source import as_sources
from sips_lit.odometry.odometer import OdometrySettings
from sips_lit.odometry.report import matrix, protocol_line, table, write_results
from sips_lit.odometry.result import SequenceResult
from sips_lit.odometry.runner import Plan, run_sequence


@dataclass
class Keys:
    """The types of the plain keys of ``conf/odometry.yaml``, which documents them."""

    threshold: float
    iterations: int
    min_inliers: int
    keyframe_inliers: float
    keyframe_motion: float
    repeats: int
    seed: int
    stride: int
    max_frames: int | None
    segment: float
    features: str


def odometry(config: DictConfig) -> None:
    """Follows the camera through every sequence by each method with each number of points; prints and writes tables."""
    cv2.setNumThreads(-1)
    plan, keys = make_plan(config)
    skipped: dict[str, str] = {}
    methods = [configured_method(config)] if config.detectors is None else make_methods(config, told(skipped))
    if not methods:
        raise BadInputError(f"no method could be made: {'; '.join(skipped.values())}")
    sequences = [sequence for source in as_sources(build(config.data)) for sequence in source.sequences]
    results = []
    for sequence in sequences:
        result = run_sequence(sequence, methods, plan, Path(keys.features), told({}), _tell_defects)
        print_result(result)
        results.append(result)
    refuse_nothing(results)
    folder = Path(config.paths.run)
    written = write_results(folder, results, date.today().isoformat())
    tell_written(folder, written)


def make_plan(config: DictConfig) -> tuple[Plan, Keys]:
    """What is run, of the configuration. Raises BadInputError for values that can't be used."""
    keys = typed(OmegaConf.create({field.name: config[field.name] for field in fields(Keys)}), Keys)
    given: Any = list(config.n) if isinstance(config.n, ListConfig) else [config.n]
    if not all(isinstance(n, int) and not isinstance(n, bool) for n in given):
        raise BadInputError(f"n is {config.n}: give points a frame, 50, or a list of them, [10,50,200]")
    settings = OdometrySettings(**{field.name: getattr(keys, field.name) for field in fields(OdometrySettings)})
    more: Mapping[str, Any] = {
        name: getattr(keys, name) for name in ("repeats", "seed", "stride", "max_frames", "segment")
    }
    return Plan(tuple(given), settings, **more), keys


def print_result(result: SequenceResult) -> None:
    """The tables of a sequence; of several numbers of points the small one."""
    if not result.results:
        return
    several = len({one.n for one in result.results}) > 1
    print(f"\n{result.name}\n\n{matrix(result) if several else table(result)}\n\n{protocol_line(result)}")


def refuse_nothing(results: Sequence[SequenceResult]) -> None:
    """Raises BadInputError when no method could follow any sequence."""
    if not any(result.results for result in results):
        reasons = "; ".join(sorted({reason for result in results for reason in result.skipped.values()}))
        raise BadInputError(f"no method could be run: {reasons}")


def _tell_defects(name: str, defects: Defects) -> None:
    if str(defects):
        print(f"sanitised: {name}: {defects}")


main = partial(run, "odometry", odometry, after_odometry)

if __name__ == "__main__":
    main()
