"""Tasks: nox runs lint, types, contracts and docs; nox -s tests -- tests/detect the tests of a folder.

Sessions use the environment that nox runs in (pip install -c constraints.txt -e '.[dev]'): torch is large, and is not
installed once more for each of them.
"""

import shutil
import sys
import sysconfig
import tempfile
from pathlib import Path

import nox

nox.options.default_venv_backend = "none"
nox.options.sessions = ["lint", "types", "contracts", "docs"]

PROGRAMS = Path(sys.executable).parent

INSTALLED = """
import sys, importlib.metadata, cv2, numpy, sips_lit
assert sips_lit.__file__.startswith(sys.argv[1]), sips_lit.__file__
page = importlib.metadata.metadata("sips_lit").get_payload()
assert "# sips_lit" in page and "](docs" not in page and "](../" not in page, "relative links in the page of the package"
cv2.imwrite("a.png", numpy.random.default_rng(0).integers(0, 255, (120, 160)).astype(numpy.uint8))
"""


def run(session: nox.Session, program: str, *arguments: str, **options: object) -> None:
    """Runs a program of this environment, whether or not it is activated."""
    session.run(str(PROGRAMS / program), *arguments, external=True, **options)


@nox.session
def lint(session: nox.Session) -> None:
    """Style."""
    run(session, "ruff", "check", ".")
    run(session, "ruff", "format", "--check", ".")


@nox.session
def types(session: nox.Session) -> None:
    """Annotations."""
    run(session, "mypy")


@nox.session
def contracts(session: nox.Session) -> None:
    """Imports run downward."""
    run(session, "lint-imports", "--no-logo", env={"PYTHONPATH": "."})


@nox.session
def docs(session: nox.Session) -> None:
    """The site, without broken links."""
    run(session, "mkdocs", "build", "--strict")  # with --quiet it would count no warning


@nox.session
def tests(session: nox.Session) -> None:
    """The tests, of what is named after -- or all."""
    run(session, "pytest", *session.posargs)


@nox.session
def coverage(session: nox.Session) -> None:
    """The tests with coverage; fails below the floor in pyproject.toml."""
    run(session, "pytest", "--cov", "--cov-report=term:skip-covered", *session.posargs)


@nox.session
def quick(session: nox.Session) -> None:
    """A short real training run with a comparison, and an export of what it trained."""
    folder = Path(tempfile.mkdtemp())
    places = {"SIPS_LIT_DATA": str(folder / "data"), "SIPS_LIT_OUTPUTS": str(folder / "outputs")}
    short = ["trainer.max_steps=20", "datamodule.val_pairs=4", "compare.pairs=4", f"hydra.run.dir={folder / 'run'}"]
    checkpoint = folder / "run" / "checkpoints" / "last.ckpt"
    try:
        run(session, "sips-train", "experiment=quickstart", *short, env=places)
        if not checkpoint.stat().st_size:
            session.error(f"{checkpoint} is empty")
        run(session, "sips-export", f"checkpoint={checkpoint}", "format=onnx", f"output={folder / 'sips.onnx'}")
    finally:
        shutil.rmtree(folder)


@nox.session
def package(session: nox.Session) -> None:
    """Wheel and sdist: what their page refuses, and whether they run when they are installed, from another folder."""
    folder = Path(tempfile.mkdtemp())
    programs = folder / "environment" / "bin"
    try:
        # the wheel is built from the sdist, so both are whole
        constraints = {"PIP_CONSTRAINT": str(Path("constraints.txt").resolve())}
        run(session, "python", "-m", "build", "--outdir", str(folder / "dist"), env=constraints)
        run(session, "twine", "check", "--strict", *map(str, (folder / "dist").iterdir()))
        run(session, "python", "-m", "venv", "--without-pip", str(folder / "environment"))
        # the dependencies, gigabytes of them, are this environment's; a sips_lit that is installed here to be edited is a
        # .pth file, which is not followed from there
        own = next((folder / "environment" / "lib").glob("python*")) / "site-packages"
        (own / "dependencies.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
        (wheel,) = (folder / "dist").glob("*.whl")
        run(
            session,
            "pip",
            "--python",
            str(programs / "python"),
            "install",
            "-q",
            "--no-deps",
            "--ignore-installed",
            str(wheel),
        )
        with session.chdir(folder):
            session.run(str(programs / "python"), "-c", INSTALLED, str(own), external=True)
            session.run(str(programs / "sips-train"), "--help", silent=True, external=True)
            session.run(str(programs / "sips-detect"), "input=a.png", "n=20", "format=csv", external=True)
            if not (folder / "points").is_dir():
                session.error("sips-detect has written nothing")
    finally:
        shutil.rmtree(folder)
