"""What the tests share: scenes, and the `tamis` program beside them."""

import os
import pathlib
import subprocess

import numpy as np
import pytest

import tamis

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENES = sorted((ROOT / "data/test").glob("*/4spp.exr"))


def program():
    """The program that cargo built."""
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    path = target / "debug" / ("tamis.exe" if os.name == "nt" else "tamis")
    assert path.is_file(), f"{path}: there is no such program; build it with `cargo build`"
    return path


def run(*arguments):
    """What the program prints, and whether it succeeds."""
    done = subprocess.run(
        [program(), *map(str, arguments)], capture_output=True, text=True, check=False, cwd=ROOT
    )
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(scope="session", params=SCENES, ids=lambda path: path.parent.name)
def scene(request):
    """Every scene in turn."""
    return request.param


@pytest.fixture(scope="session")
def frame():
    """The features of a scene as arrays."""
    assert len(SCENES) >= 3
    return tamis.read(SCENES[0])


@pytest.fixture(scope="session")
def colors(frame):
    """Those that most renderers write, and the result for them."""
    given = {name: frame[name] for name in ("color", "albedo", "normal", "depth")}
    return given, tamis.denoise(**given)


def large(rows=1600, columns=1600):
    """A frame that takes long enough for something to happen meanwhile."""
    rng = np.random.default_rng(1)
    return rng.random((rows, columns, 3), dtype=np.float32)
