#!/usr/bin/env python3
"""Render the training and test scenes: noisy images with features, and references.

python3 scenes/render.py                     all scenes, into data/
python3 scenes/render.py --scene study       one of them
python3 scenes/render.py --preview /tmp      fast: few samples, a PNG to look at, no data written
"""

import argparse
import importlib
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import exr  # noqa: E402
import measure  # noqa: E402

# Passes of one sample per pixel each: their spread gives the variances.
PASSES = 4
VECTORS = {"Position": "XYZ", "Normal": "XYZ", "Albedo": "RGB", "SecondaryAlbedo": "RGB", "Depth": "Z", "Direct": "RGB"}
# Seeds of the reference's halves, far from each other and from the noisy image's.
HALVES = (1_000_000, 2_000_000)
PREVIEW_SPP = 16


def scenes():
    """Name -> module path of every scene."""
    return {
        p.stem: f"{p.parent.name}.{p.stem}"
        for group in ("train", "test")
        for p in sorted((HERE / group).glob("[!_]*.py"))
    }


def renderer(scene):
    """The scene's renderer, ready to sample."""
    if scene.RENDERER == "mitsuba":
        import mitsuba_stage as stage
    else:
        import cycles_stage as stage
    return stage.Renderer(scene.build(), scene.SIZE, scene.CLAMP / scene.EXPOSURE, scene.MAX_DEPTH)


def noisy(render, exposure, first_seed):
    """The 28 channels: means of the passes and sample variances of those means."""
    passes = [render.sample(first_seed + i) for i in range(PASSES)]
    mean, variance = {}, {}
    for name in passes[0]:
        stack = np.stack([p[name] for p in passes])
        if name in "RGB" or name.startswith("Direct"):
            stack = stack * exposure
        mean[name] = stack.mean(0)
        variance[name] = stack.var(0, ddof=1) / PASSES
    out = dict(mean)
    for c in "RGB":
        out["Variance." + c] = variance[c]
    for feature, components in VECTORS.items():
        out[feature + ".Variance"] = np.mean([variance[f"{feature}.{c}"] for c in components], 0)
    return out


def report(name, scene, spp, channels, halves, seconds):
    """One row of numbers, as in the README's table and then some."""
    reference = (halves[0] + halves[1]) / 2
    colour, variance = measure.planes(channels, ""), measure.planes(channels, "Variance.")
    error, own = measure.relmse(colour, reference), measure.reference_noise(*halves)
    second = measure.planes(channels, "SecondaryAlbedo.").max(-1)
    cells = [
        name,
        scene.RENDERER,
        f"{scene.SIZE[0]}x{scene.SIZE[1]}",
        f"{spp} spp",
        f"clamp {scene.CLAMP:g}",
        f"{error[0]:.3f} ({error[1]:.3f})",
        f"{own[0] / error[0]:.2%} ({own[1] / error[1]:.2%})",
        f"mean {reference.mean():.3f}",
        f"bias {measure.bias(colour, variance, reference):+.1f} se",
        f"calibration {measure.calibration(colour, variance, reference):.2f}",
        f"no hit {np.mean(channels['Depth.Z'] == 0):.1%}",
        f"secondary {np.mean(second > 0):.0%}",
        f"{seconds:.0f} s",
    ]
    print("| " + " | ".join(cells) + " |", flush=True)


def render_scene(name, module, out, preview=None):
    start = time.time()
    scene = importlib.import_module(module)
    render = renderer(scene)
    channels = noisy(render, scene.EXPOSURE, 1)
    spp = PREVIEW_SPP if preview else scene.REFERENCE_SPP
    halves = [render.mean(spp // 2, seed) * scene.EXPOSURE for seed in HALVES]
    reference = (halves[0] + halves[1]) / 2
    report(name, scene, spp, channels, halves, time.time() - start)
    if preview:
        measure.contact_sheet(Path(preview) / f"{name}.png", channels, reference)
        return
    folder = out / module.split(".")[0] / name
    folder.mkdir(parents=True, exist_ok=True)
    exr.write(folder / "4spp.exr", channels)
    exr.write(folder / "reference.exr", dict(zip("RGB", np.moveaxis(reference, -1, 0))))


def main():
    known = scenes()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", action="append", choices=sorted(known), help="render only this one (repeatable)")
    parser.add_argument("--out", type=Path, default=HERE.parent / "data", help="folder for train/ and test/")
    parser.add_argument("--preview", metavar="DIR", help="write a PNG at few samples instead of data")
    arguments = parser.parse_args()
    for name in arguments.scene or known:
        render_scene(name, known[name], arguments.out, arguments.preview)


if __name__ == "__main__":
    main()
