import io
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from exported_models import BUDGETS, SIZES, exported, model_of, textured

from sips_lit.detect.budget import Budget
from sips_lit.detect.checkpoint import config_json
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.export.dense_map import DenseMap
from sips_lit.export.program import metadata_of, program_of


@pytest.mark.parametrize("name", ["map", "enough"])
def test_the_program_gives_what_the_module_does(name):
    content = exported(name, "torch_export")[0][".pt2"]
    program = torch.export.load(io.BytesIO(content)).module()
    for batch, size in [*((1, size) for size in SIZES), (2, (33, 47))]:
        images = torch.from_numpy(np.stack([textured(size, seed) for seed in range(batch)]))[:, None].float()
        for mine, expected in zip(program(images), model_of(name)(images), strict=True):
            torch.testing.assert_close(mine, expected, rtol=0, atol=1e-6)


def test_the_file_tells_what_it_is():
    model, extra = model_of("enough"), dict.fromkeys(metadata_of(model_of("enough")), "")
    torch.export.load(io.BytesIO(exported("enough", "torch_export")[0][".pt2"]), extra_files=extra)
    assert json.loads(extra["sips_lit"]) == json.loads(config_json(model.network, model.selector))
    assert Budget(**json.loads(extra["sips_lit_budget"])) == BUDGETS["enough"]
    assert "sips_lit_budget" not in metadata_of(model_of("map"))


def test_nothing_of_this_machine_is_in_the_file():
    content = exported("enough", "torch_export")[0][".pt2"]
    for trace in (b".py", b"sips_lit/", str(Path(__file__).parents[2]).encode()):
        assert trace not in content


def test_operations_do_not_depend_on_a_free_size():
    network = ScoreNetwork(3, 4, first_octave=1, whole_below=500)
    with pytest.raises(ValueError, match="a model for any size scores all alike: give a network with whole_below=0"):
        program_of(DenseMap(network, PointSelector()))
