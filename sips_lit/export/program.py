"""An exported model as a program of torch.export (.pt2), for images of any size; other formats are made from it."""

from __future__ import annotations

import io
import json
from dataclasses import asdict
from importlib.metadata import version
from typing import Final

import torch
from torch.export import Dim, ExportedProgram

from sips_lit.detect.checkpoint import METADATA_KEY, config_json
from sips_lit.export.dense_map import DenseMap
from sips_lit.export.top_k import TopPoints

Exportable = DenseMap | TopPoints
Size = tuple[int, int]
"""(H, W)."""

IMAGE_TYPES: Final = {"float32": torch.float32, "uint8": torch.uint8}
"""Of the values of an image, 0 to 255."""


def program_of(model: Exportable, image_type: str = "float32", size: Size | None = None) -> ExportedProgram:
    """The operations of a model on an ``image`` (B, 1, H, W) whose B, H and W are free, or (1, 1, H, W) of one ``size``.

    Operations do not depend on a free size: raises ValueError for a network that scores small images otherwise
    (``whole_below``) without a ``size``.
    """
    if size is None:
        if model.network.detection.whole_below:
            raise ValueError("a model for any size scores all alike: give a network with whole_below=0, or a size")
        side = 4 * model.network.radius
        shape = 2, 1, side, side + 2  # a size of 1 would be taken for a constant
        free: dict[int, Dim] | None = {0: Dim("batch"), 2: Dim("height"), 3: Dim("width")}
    else:
        shape, free = (1, 1, *size), None
    example = torch.zeros(shape, dtype=IMAGE_TYPES[image_type])
    with torch.no_grad():
        program = torch.export.export(
            model,
            (example,),
            dynamic_shapes=(free,),
            prefer_deferred_runtime_asserts_over_guards=True,  # that an octave is half the one before is no guess
        )
    for module in program.graph_module.modules():
        for node in module.graph.nodes if isinstance(module, torch.fx.GraphModule) else []:
            node.meta.pop("stack_trace", None)  # paths of this machine
    return program


def metadata_of(model: Exportable) -> dict[str, str]:
    """What a reader may want to know of a model: its configuration as JSON, and the version that wrote it."""
    entries = {METADATA_KEY: config_json(model.network, model.selector), "sips_lit_version": version("sips_lit")}
    if isinstance(model, TopPoints):
        entries["sips_lit_budget"] = json.dumps(asdict(model.budget), sort_keys=True)
    return entries


def program_bytes(program: ExportedProgram, model: Exportable) -> bytes:
    """The ``.pt2`` file, with the metadata as extra files."""
    buffer = io.BytesIO()
    torch.export.save(program, buffer, extra_files=metadata_of(model))
    return buffer.getvalue()
