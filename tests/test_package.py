"""The public names of `sips_lit`: they exist, load late, and are typed."""

import ast
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from markdown_code import ROOT, blocks

import sips_lit

PACKAGE = Path(sips_lit.__file__).parent


def test_every_public_name_is_there_and_listed():
    for name in sips_lit.__all__:
        assert getattr(sips_lit, name) is not None, name
        assert name in dir(sips_lit)


def test_names_are_those_of_the_rooms():
    from sips_lit.datasets.kitti import kitti
    from sips_lit.detect.detector import SipsDetector
    from sips_lit.matching.mutual_nearest import mutual_nearest

    assert sips_lit.SipsDetector is SipsDetector
    assert sips_lit.mutual_nearest is mutual_nearest
    assert sips_lit.kitti is kitti


def test_no_public_name_hides_a_module():
    modules = {path.stem for path in PACKAGE.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()}
    assert not modules & set(sips_lit.__all__), "importing the module would replace the name"


def test_unknown_names_are_refused():
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = sips_lit.nonsense
    with pytest.raises(ImportError, match="nonsense"):
        from sips_lit import nonsense  # noqa: F401


def test_type_checkers_see_the_same_names():
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    block = next(n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING")
    imported = {
        (node.module, alias.name, alias.asname)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    loaded = {(f"sips_lit.{module}", name, name) for module, names in sips_lit.PUBLIC.items() for name in names}
    assert imported == loaded


def test_the_version_is_that_of_the_project():
    with (ROOT / "pyproject.toml").open("rb") as file:
        assert sips_lit.__version__ == tomllib.load(file)["project"]["version"]


def test_importing_the_package_loads_nothing_slow():
    code = "import sys, json, sips_lit; dir(sips_lit); print(json.dumps(sorted(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in json.loads(run.stdout)}
    assert "sips_lit" in loaded
    assert not loaded & {"torch", "cv2", "numpy", "matplotlib", "lightning", "torchmetrics", "hydra", "omegaconf"}


def test_records_load_without_torch():
    code = "import sys; from sips_lit import Keypoints, BadInputError; print('torch' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


# what torch and onnx are made of, and no example uses: half of the work of mypy
INNER = "torch._inductor.*,torch._dynamo.*,torch.ao.*,torch.fx.*,torch.onnx.*,onnx.*,onnx_ir.*,onnxscript.*,rich.*"


@pytest.mark.slow
def test_the_python_of_readme_and_docs_is_typed(tmp_path):
    """In a strict project of a user's own, against the package as it is shipped: with its annotations, without stubs."""
    assert (PACKAGE / "py.typed").is_file()
    written = {}
    for number, block in enumerate(blocks("python")):
        file = tmp_path / f"example_{number}.py"
        file.write_text(block.text, encoding="utf-8")
        written[file.name] = block
    assert any(block.page == "README.md" for block in written.values())
    (tmp_path / "mypy.ini").write_text(f"[mypy]\n[mypy-{INNER}]\nfollow_imports = skip\n")
    check = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--cache-dir=/dev/null", *written]
    run = subprocess.run(
        check, cwd=tmp_path, env={"PATH": "/usr/bin:/bin", "MYPYPATH": str(ROOT)}, capture_output=True, text=True
    )
    assert run.returncode == 0, f"{run.stdout}{run.stderr}{ {name: str(block) for name, block in written.items()} }"
