#!/usr/bin/env python3
"""How filters stand: errors on scenes, beside Open Image Denoise.

    standing.py errors TAMIS --filters F... --scenes FOLDER... [--oidn OIDNDENOISE]
    standing.py cleaner TAMIS --filters F... --scenes FOLDER... [--oidn OIDNDENOISE]
    standing.py pictures TAMIS --filters F... --scenes FOLDER... [--oidn OIDNDENOISE] --out FOLDER

`errors` filters the scene in every FOLDER (4spp.exr, reference.exr) as it is, with colour,
albedo and normal alone, and with colour alone, and prints geometric means over the scenes of
RelMSE / RelMSE without the worst 0.1% of the pixels / FLIP, as a Markdown table.

`cleaner` filters images of more and more samples: every Nspp.exr in the folders, and the one
of most samples with its colour's noise scaled to 256 and 1,024. It prints by how much errors
grow or shrink: the geometric mean and the worst of error after / error before. Three kinds of
file are told apart: with variances, without, and without but with `--samples` for `tamis`.
Noise scaled to nothing is the reference itself; its rows have errors, not quotients.

`pictures` writes a PNG per scene: noisy, filtered by each, reference, side by side.

RelMSE is the mean over pixels and channels of (x - r)^2 / (r^2 + 0.01). For FLIP (67 pixels per
degree) both images are exposed so that the reference's mean luminance is 0.6, put through
y / (1 + y), and laid out by the sRGB curve.

Needs flip-evaluator, numpy, OpenEXR and, for pictures, pillow from PyPI.
"""

import argparse
import glob
import os
import re
import subprocess
import tempfile
from pathlib import Path

import flip_evaluator
import numpy
import OpenEXR

LUMINANCE = numpy.array([0.2126, 0.7152, 0.0722], numpy.float32)

# What is left of a file, by the beginnings of its channels' names; everything for nothing.
FEATURES = {
    "all features": None,
    "colour, albedo, normal": ("R", "G", "B", "Variance", "Albedo", "Normal"),
    "colour": ("R", "G", "B", "Variance"),
}


def read(path):
    """The channels of a file by name."""
    channels = OpenEXR.File(str(path), separate_channels=True).parts[0].channels
    return {name: numpy.asarray(channel.pixels, numpy.float32) for name, channel in channels.items()}


def write(path, channels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, dict(channels)).write(str(path))


def colour(channels, prefix=""):
    return numpy.stack([channels[prefix + c] for c in "RGB"], axis=-1)


def picture(image, reference):
    """What FLIP looks at: height x width x 3, in [0, 1]."""
    exposed = numpy.clip(image, 0, None) * (0.6 / max(float((reference @ LUMINANCE).mean()), 1e-6))
    mapped = exposed / (1 + exposed)
    low, high = mapped * 12.92, 1.055 * numpy.power(mapped, 1 / 2.4) - 0.055
    return numpy.where(mapped <= 0.0031308, low, high).astype(numpy.float32)


def errors(image, reference):
    """RelMSE, the same without the worst 0.1% of the pixels, FLIP."""
    by_pixel = ((image - reference) ** 2 / (reference**2 + 0.01)).mean(-1, dtype=numpy.float64).ravel()
    kept = numpy.sort(by_pixel)[: len(by_pixel) - len(by_pixel) // 1000]
    pictures = [picture(x, reference) for x in (reference, image)]
    flip = flip_evaluator.evaluate(*pictures, "LDR", applyMagma=False)[1]
    return [by_pixel.mean(), kept.mean(), float(flip)]


class Contest:
    """Filters and Open Image Denoise, applied to channels."""

    def __init__(self, arguments):
        self.tamis, self.oidn = arguments.tamis, arguments.oidn
        self.names = list(arguments.filters)
        if self.oidn:
            self.names += [f"OIDN {quality}" for quality in arguments.qualities]

    def apply(self, name, channels, *options):
        with tempfile.TemporaryDirectory() as work:
            if name.startswith("OIDN "):
                return self.denoise(Path(work), name.split()[1], channels)
            noisy, result = Path(work) / "noisy.exr", Path(work) / "result.exr"
            write(noisy, channels)
            command = [self.tamis, "--quiet", "denoise", noisy, "-o", result, "--filter", name]
            command += [str(option) for option in options]
            subprocess.run(command, check=True, capture_output=True)
            return colour(read(result))

    def denoise(self, work, quality, channels):
        """Open Image Denoise, with albedo and normal where there are any."""
        command = [self.oidn, "--hdr", work / "colour.pfm", "-o", work / "result.pfm", "-q", quality]
        pfm(work / "colour.pfm", colour(channels))
        if "Albedo.R" in channels:
            pfm(work / "albedo.pfm", numpy.clip(colour(channels, "Albedo."), 0, 1))
            command += ["--alb", work / "albedo.pfm"]
        if "Normal.X" in channels:
            pfm(work / "normal.pfm", numpy.stack([channels["Normal." + c] for c in "XYZ"], axis=-1))
            command += ["--nrm", work / "normal.pfm"]
        # The library lies beside the program in the wheel and in the release.
        libraries = Path(self.oidn).resolve().parent.parent / "lib"
        known = os.environ.get("LD_LIBRARY_PATH", "")
        environment = os.environ | {"LD_LIBRARY_PATH": f"{libraries}:{known}"}
        subprocess.run(command, check=True, capture_output=True, env=environment)
        return read_pfm(work / "result.pfm")


def pfm(path, image):
    rows = numpy.ascontiguousarray(image[::-1].astype("<f4"))
    path.write_bytes(b"PF\n%d %d\n-1.0\n" % (rows.shape[1], rows.shape[0]) + rows.tobytes())


def read_pfm(path):
    _, size, _, pixels = path.read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    return numpy.frombuffer(pixels, "<f4").reshape(height, width, 3)[::-1]


def mean(values):
    """The geometric mean down a list of rows."""
    return numpy.exp(numpy.log(numpy.maximum(values, 1e-12)).mean(0))


def row(cells):
    print("| " + " | ".join(cells) + " |", flush=True)


def standing(contest, folders):
    row(["RelMSE / trimmed / FLIP", *FEATURES])
    row(["---", *["---:"] * len(FEATURES)])
    scenes = [(read(f / "4spp.exr"), colour(read(f / "reference.exr"))) for f in folders]
    noisy = mean([errors(colour(channels), reference) for channels, reference in scenes])
    cell = lambda triple: " / ".join(f"{x:.4f}" for x in triple)
    row(["noisy", cell(noisy), "", ""])
    for name in contest.names:
        cells = []
        for kept in FEATURES.values():
            table = []
            for channels, reference in scenes:
                left = {n: c for n, c in channels.items() if kept is None or n.split(".")[0] in kept}
                try:
                    table.append(errors(contest.apply(name, left), reference))
                except subprocess.CalledProcessError:
                    break
            cells.append(cell(mean(table)) if len(table) == len(scenes) else "-")
        row([name, *cells])


NOISELESS = 0


def levels(folder):
    """The noisy images of a scene by their number of samples, some of them of scaled noise."""
    files = {int(re.match(r"\d+", f.name)[0]): f for f in folder.glob("*spp.exr")}
    images = {samples: read(file) for samples, file in sorted(files.items())}
    most, reference = max(images), colour(read(folder / "reference.exr"))
    for samples in (256, 1024, NOISELESS):
        share = (most / samples) ** 0.5 if samples != NOISELESS else 0.0
        scaled = dict(images[most])
        for k, c in enumerate("RGB"):
            truth = numpy.ascontiguousarray(reference[..., k])
            scaled[c] = truth + share * (scaled[c] - truth)
            if "Variance." + c in scaled:
                scaled["Variance." + c] = scaled["Variance." + c] * share**2
        images[samples] = scaled
    return images, reference


def cleaner(contest, folders):
    row(["error after / before: mean (worst)", "file", "samples", "scenes", "RelMSE", "FLIP"])
    row(["---", "---", "---:", "---:", "---:", "---:"])
    ratios = {}
    for folder in folders:
        images, reference = levels(folder)
        for samples, channels in images.items():
            before = errors(colour(channels), reference)
            bare = {name: c for name, c in channels.items() if "Variance" not in name}
            known = samples if samples != NOISELESS else 65536
            for name in contest.names:
                files = [("with variances", channels, [])]
                if not name.startswith("OIDN"):
                    files += [("without", bare, []), ("without, samples known", bare, ["--samples", known])]
                for file, given, options in files:
                    after = errors(contest.apply(name, given, *options), reference)
                    pairs = [(after[k], before[k]) for k in (0, 2)]
                    ratio = [a if samples == NOISELESS else (a + 1e-12) / (b + 1e-12) for a, b in pairs]
                    ratios.setdefault((name, file, samples or float("inf")), []).append(ratio)
    for (name, file, samples), table in sorted(ratios.items()):
        means, worst = mean(table), numpy.max(table, axis=0)
        digits = (lambda x: f"{x:.1e}") if samples == float("inf") else (lambda x: f"{x:.3f}")
        cells = [f"{digits(means[k])} ({digits(worst[k])})" for k in range(2)]
        row([name, file, f"{samples:.0f}", str(len(table)), *cells])


def pictures(contest, folders, out):
    from PIL import Image

    out.mkdir(parents=True, exist_ok=True)
    for folder in folders:
        channels, reference = read(folder / "4spp.exr"), colour(read(folder / "reference.exr"))
        images = [colour(channels), *(contest.apply(name, channels) for name in contest.names), reference]
        strip = numpy.concatenate([picture(image, reference) for image in images], axis=1)
        Image.fromarray((255 * strip + 0.5).astype(numpy.uint8)).save(out / f"{folder.name}.png")
        print(out / f"{folder.name}.png", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["errors", "cleaner", "pictures"])
    parser.add_argument("tamis", help="the program")
    parser.add_argument("--filters", nargs="+", required=True, help="names or files")
    parser.add_argument("--scenes", nargs="+", type=Path, required=True, help="folders, or folders of such")
    parser.add_argument("--oidn", help="the program oidnDenoise")
    parser.add_argument("--qualities", nargs="+", default=["fast", "balanced", "high"], help="of Open Image Denoise")
    parser.add_argument("--out", type=Path, help="where pictures go")
    arguments = parser.parse_args()
    below = [glob.glob(f"{given}/**/reference.exr", recursive=True) for given in arguments.scenes]
    folders = sorted({Path(file).parent for files in below for file in files})
    if not folders:
        parser.error("no folder with reference.exr below --scenes")
    contest = Contest(arguments)
    if arguments.what == "pictures":
        if not arguments.out:
            parser.error("pictures need --out")
        pictures(contest, folders, arguments.out)
    else:
        {"errors": standing, "cleaner": cleaner}[arguments.what](contest, folders)


main()
