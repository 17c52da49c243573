#!/usr/bin/env python3
"""Makes a filter that suits one scene: renders it, tunes a filter on parts of it, compares.

    python examples/tune_a_scene.py --out out/scene                    # the Cornell box
    python examples/tune_a_scene.py kitchen.xml --out out/kitchen --steps 5000

Renders the scene of a Mitsuba file at 1, 4 and 16 samples per pixel, with the features that
filters read, and at many as a reference. Of its tiles every other one is tuned on; the rest
are to judge by. Then `tamis tune` starts from the filter that ships, and `tamis score` shows
both on the tiles that were not tuned on.

Needs scenes/requirements.txt (pip install -r) and `cargo build --release`. Another renderer's
files do as well: all that `tamis tune` wants are folders with 4spp.exr and reference.exr.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scenes"))

import exr  # noqa: E402
import mitsuba_stage  # noqa: E402  (chooses Mitsuba's variant)
import render  # noqa: E402

mi = mitsuba_stage.mi

# Columns and rows of a tile.
TILE = 96


class Whole(mitsuba_stage.Renderer):
    """A scene as its file has it."""

    def __init__(self, scene, clamp):
        self.scene = scene
        self.size = tuple(scene.sensors()[0].film().crop_size())
        self.drift, self.eye = None, None
        shared = {"type": "feature_path", "clamp": float(clamp), "max_depth": 16}
        self.with_features = mi.load_dict(shared | {"features": True})
        self.colour_only = mi.load_dict(shared | {"features": False})


def images(whole, samples, first_seed):
    """The channels at a number of samples: those at four have variances."""
    if samples == render.PASSES:
        return render.noisy(whole, 1.0, first_seed)
    passes = [whole.sample(first_seed + k) for k in range(samples)]
    mean = {name: np.mean([p[name] for p in passes], axis=0) for name in passes[0]}
    if samples > 1:
        for c in "RGB":
            mean["Variance." + c] = np.var([p[c] for p in passes], axis=0, ddof=1) / samples
    return mean


def tiles(size):
    """The corners of the tiles, and whether each is tuned on."""
    for y in range(0, size[1] - TILE // 2, TILE):
        for x in range(0, size[0] - TILE // 2, TILE):
            yield x, y, (x // TILE + y // TILE) % 2 == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", help="a Mitsuba file; the Cornell box if there is none")
    parser.add_argument("--out", type=Path, required=True, help="folder for images and the filter")
    parser.add_argument("--reference", type=int, default=1024, help="samples per pixel of the reference")
    parser.add_argument("--clamp", type=float, default=10, help="of indirect light at a vertex, in both images")
    parser.add_argument("--filter", default="tamis", help="what to start from")
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--tamis", default=ROOT / "target/release/tamis", help="the program")
    arguments = parser.parse_args()

    scene = mi.load_file(arguments.scene) if arguments.scene else mi.load_dict(mi.cornell_box())
    whole = Whole(scene, arguments.clamp)
    levels = {samples: images(whole, samples, 1 + 100 * samples) for samples in (1, 4, 16)}
    reference = whole.mean(arguments.reference, 1_000_000)
    for x, y, tuned in tiles(whole.size):
        folder = arguments.out / ("train" if tuned else "validate") / f"tile_{x}_{y}"
        folder.mkdir(parents=True, exist_ok=True)
        part = np.s_[y : y + TILE, x : x + TILE]
        for samples, channels in levels.items():
            exr.write(folder / f"{samples}spp.exr", {name: c[part] for name, c in channels.items()})
        colours = np.moveaxis(reference[part], -1, 0)
        exr.write(folder / "reference.exr", dict(zip("RGB", colours)))

    tuned = arguments.out / "tuned.toml"
    sets = ["--scenes", arguments.out / "train", "--validate", arguments.out / "validate"]
    steps = ["--steps", str(arguments.steps), "--interval", str(max(arguments.steps // 10, 1))]
    # It starts near where it is to go.
    rates = ["--rate", "0.005", "--layer-rate", "0.001", "--crop", "64"]
    subprocess.run([arguments.tamis, "tune", arguments.filter, *sets, "-o", tuned, "--overwrite", *steps, *rates], check=True)
    score = ["score", "--scenes", arguments.out / "validate", "--filters", arguments.filter, tuned]
    subprocess.run([arguments.tamis, *score], check=True)


main()
