#!/usr/bin/env python3
"""FLIP of filtered images, judged by NVIDIA's flip-evaluator.

    flip.py TAMIS FILTER[,FILTER...] FOLDER...

Filters the scene in every FOLDER (4spp.exr, reference.exr) with every FILTER by running
the program TAMIS, and prints a Markdown table of the mean FLIP errors with their
geometric means. Images are clamped to [0, 1] and laid out by the sRGB curve, as the
program's PNG files are; FLIP is for 67 pixels per degree.

Needs flip-evaluator, numpy and OpenEXR from PyPI.
"""

import math
import subprocess
import sys
import tempfile
from pathlib import Path

import flip_evaluator
import numpy
import OpenEXR


def srgb(path):
    """The image as FLIP looks at it: height x width x 3, in [0, 1]."""
    channels = OpenEXR.File(str(path), separate_channels=True).parts[0].channels
    rgb = numpy.stack([channels[name].pixels for name in "RGB"], axis=-1)
    linear = numpy.clip(rgb.astype(numpy.float32), 0.0, 1.0)
    low, high = linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055
    return numpy.where(linear <= 0.0031308, low, high).astype(numpy.float32)


def flip(reference, image):
    """The mean FLIP error."""
    return float(flip_evaluator.evaluate(reference, image, "LDR", applyMagma=False)[1])


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    tamis, filters = sys.argv[1], sys.argv[2].split(",")
    folders = [Path(folder) for folder in sys.argv[3:]]
    print("| FLIP | noisy |", " | ".join(filters), "|")
    print("|---|---:|" + "---:|" * len(filters))
    logs = [[] for _ in range(len(filters) + 1)]
    for folder in folders:
        reference = srgb(folder / "reference.exr")
        errors = [flip(reference, srgb(folder / "4spp.exr"))]
        with tempfile.TemporaryDirectory() as work:
            result = Path(work) / "filtered.exr"
            for name in filters:
                command = [tamis, "denoise", folder / "4spp.exr", "-o", result, "--filter", name]
                subprocess.run(command, check=True, capture_output=True)
                errors.append(flip(reference, srgb(result)))
        print(f"| {folder.name} |", " | ".join(f"{error:.4f}" for error in errors), "|")
        for log, error in zip(logs, errors):
            log.append(math.log(error))
    means = [math.exp(sum(log) / len(log)) for log in logs]
    print("| geometric mean |", " | ".join(f"{mean:.4f}" for mean in means), "|")


main()
