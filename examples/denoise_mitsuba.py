#!/usr/bin/env python3
"""Renders a scene with Mitsuba 3, denoises it in memory, and compares it with a longer render.

    pip install ./python mitsuba
    python examples/denoise_mitsuba.py --out out/mitsuba                   # the Cornell box
    python examples/denoise_mitsuba.py kitchen.xml --out out/kitchen

Mitsuba's integrator `aov` gives albedo, normals and depth beside the colour. The image is rendered
in a few passes, whose scatter is the variance of their mean: filters do better with one than with
an estimate. Nothing goes through a file but the pictures that are looked at: noisy.png, clean.png
and reference.png.
"""

import argparse
from pathlib import Path

import mitsuba as mi
import numpy as np

import tamis

mi.set_variant("scalar_rgb")

# Variances come from so many renders.
PASSES = 4
# What `aov` gives beside the colour, in this order, with the number of components.
GUIDES = {"albedo": ("albedo:albedo", 3), "normal": ("normal:sh_normal", 3), "depth": ("depth:depth", 1)}


def cornell_box(size):
    """The Cornell box. Filters want pixels that share no samples: the box filter's."""
    scene = mi.cornell_box()
    scene["sensor"]["film"] |= {"width": size, "height": size, "rfilter": {"type": "box"}}
    return mi.load_dict(scene)


def render(scene, samples, seed):
    """The colour and its guides, by the names of tamis.denoise's arguments."""
    light = {"type": "path", "max_depth": 16}
    aovs = ",".join(name for name, _ in GUIDES.values())
    integrator = mi.load_dict({"type": "aov", "aovs": aovs, "image": light})
    image = np.asarray(mi.render(scene, integrator=integrator, spp=samples, seed=seed), np.float32)
    channels = {"color": image[..., :3]}
    at = image.shape[2] - sum(width for _, width in GUIDES.values())
    for name, (_, width) in GUIDES.items():
        channels[name] = image[..., at] if width == 1 else image[..., at : at + width]
        at += width
    return channels


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", nargs="?", type=Path, help="a Mitsuba scene file [default: the Cornell box]")
    parser.add_argument("--out", type=Path, default=Path("out/mitsuba"), help="folder for the pictures")
    parser.add_argument("--size", type=int, default=128, help="pixels per side of the Cornell box")
    parser.add_argument("--samples", type=int, default=16, help="samples per pixel, a multiple of 4")
    parser.add_argument("--reference", type=int, default=512, help="samples of the longer render")
    parser.add_argument("--filter", default="tamis", help="a filter's name, a file or a weight")
    arguments = parser.parse_args()
    if arguments.samples < PASSES or arguments.samples % PASSES:
        parser.error(f"--samples {arguments.samples}: it must be a multiple of {PASSES}")

    scene = mi.load_file(str(arguments.scene)) if arguments.scene else cornell_box(arguments.size)
    each = arguments.samples // PASSES
    passes = [render(scene, each, seed) for seed in range(PASSES)]
    frame = {name: np.mean([one[name] for one in passes], axis=0) for name in passes[0]}
    frame["color_variance"] = np.var([one["color"] for one in passes], axis=0, ddof=1) / PASSES

    denoiser = tamis.Denoiser(arguments.filter)
    clean = denoiser.denoise(**frame, samples=arguments.samples)
    reference = render(scene, arguments.reference, PASSES)["color"]

    arguments.out.mkdir(parents=True, exist_ok=True)
    height, width, _ = clean.shape
    took = 1000 * denoiser.report["filtering_seconds"]
    print(f"{width}x{height} pixels, filter `{denoiser.filter.name}`, {took:.0f} ms")
    images = {"noisy": frame["color"], "clean": clean, "reference": reference}
    for name, image in images.items():
        tamis.show(image).save(arguments.out / f"{name}.png")
        if image is not reference:
            figures = tamis.compare(image, reference)
            print(
                f"{name:>6}: RelMSE {figures['rel_mse']:.5f}, PSNR {figures['psnr_db']:.2f} dB, "
                f"SSIM {figures['ssim']:.4f}, FLIP {figures['flip']:.4f}"
            )
    print(f"pictures are in {arguments.out}")


if __name__ == "__main__":
    main()
