#!/usr/bin/env python3
"""Look at the corpus: a table of numbers, a scan of every file, and contact sheets of all scenes.

python3 scenes/corpus/check.py                  the table; exits with 1 if a scene is not as it should be
python3 scenes/corpus/check.py --sheet /tmp     also train.png and validate.png: noisy beside reference
python3 scenes/corpus/check.py --sheet /tmp --features
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

import exr  # noqa: E402
import measure  # noqa: E402
from corpus import render  # noqa: E402

CELL, LABEL, COLUMNS = 112, 12, 6
tone = lambda a: np.clip(a, 0, 1) ** (1 / 2.2)


def cell(pictures, name):
    out = Image.new("RGB", (CELL * len(pictures), CELL + LABEL), (30, 30, 30))
    for i, p in enumerate(pictures):
        image = Image.fromarray((np.clip(p, 0, 1) * 255).astype("u1"))
        k = CELL / max(image.size)
        out.paste(image.resize((int(image.width * k), int(image.height * k))), (i * CELL, LABEL))
    ImageDraw.Draw(out).text((2, 0), name, fill=(230, 230, 230))
    return out


def sheet(cells, path):
    width, height = cells[0].size
    columns = max(1, COLUMNS * 2 * CELL // width)
    out = Image.new("RGB", (columns * width, -(-len(cells) // columns) * height))
    for i, c in enumerate(cells):
        out.paste(c, (i % columns * width, i // columns * height))
    out.save(path)


def check(name, folder, note):
    """(row of the table, complaints, channels, reference)."""
    files = {n: folder / f"{n}spp.exr" for n in render.COUNTS if (folder / f"{n}spp.exr").exists()}
    read = {n: exr.read(path) for n, path in files.items()}
    reference = measure.planes(exr.read(folder / "reference.exr"), "")
    bad = []
    for n, channels in read.items():
        broken = [c for c, a in channels.items() if not np.isfinite(a).all()]
        negative = [c for c in channels if ("Variance" in c or c in "RGB") and channels[c].min() < 0]
        if broken or negative:
            bad.append(f"{n}spp: not finite {broken}, negative {negative}")
        if len(channels) != (28 if n > 1 else 19):
            bad.append(f"{n}spp: {len(channels)} channels")
    errors = {n: measure.relmse(measure.planes(c, ""), reference) for n, c in read.items()}
    shown = read.get(4) or read[min(read)]
    own = note.get("reference_noise", "-"), note.get("reference_noise_trimmed", "-")
    if own[1] != "-" and float(own[1]) > render.NOISE_LIMIT:
        bad.append(f"reference's noise {own[1]}")
    row = [
        name,
        f"{reference.shape[1]}x{reference.shape[0]}",
        " ".join(f"{n}:{e[1]:.3f}" for n, e in errors.items()),
        f"reference {note.get('reference_spp', '-')} spp, noise {own[0]} ({own[1]})",
        f"mean {reference.mean():.3f}",
        f"no hit {np.mean(shown['Depth.Z'] == 0):.0%}",
        f"albedo to {max(shown['Albedo.' + c].max() for c in 'RGB'):.2g}",
    ]
    several = [n for n in read if n > 1]
    if several:
        n = several[0]
        variance = measure.planes(read[n], "Variance.")
        row.append(f"bias {measure.bias(measure.planes(read[n], ''), variance, reference):+.1f} se")
        row.append(f"calibration {measure.calibration(measure.planes(read[n], ''), variance, reference):.2f}")
    return row, bad, shown, reference


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=HERE.parents[1] / "data/corpus")
    parser.add_argument("--sheet", type=Path, metavar="DIR", help="write the contact sheets here")
    parser.add_argument("--features", action="store_true", help="sheets with normals, albedo and direct light too")
    a = parser.parse_args()
    table, cells, wrong, missing = render.notes(a.data), {"train": [], "validate": []}, 0, 0
    for name, _, _, split, _ in render.scenes():
        folder = a.data / split / name
        if not (folder / "reference.exr").exists():
            missing += 1
            continue
        row, bad, channels, reference = check(name, folder, table.get(name, {}))
        print(" | ".join(row), *[f"!! {b}" for b in bad], flush=True)
        wrong += bool(bad)
        pictures = [tone(measure.planes(channels, "")), tone(reference)]
        if a.features:
            pictures += [
                measure.planes(channels, "Normal.", "XYZ") * 0.5 + 0.5,
                tone(measure.planes(channels, "Albedo.")),
                tone(measure.planes(channels, "SecondaryAlbedo.")),
                tone(measure.planes(channels, "Direct.")),
            ]
        cells[split].append(cell(pictures, name))
    print(f"{sum(map(len, cells.values()))} scenes, {wrong} with complaints, {missing} not rendered")
    if a.sheet:
        a.sheet.mkdir(parents=True, exist_ok=True)
        for split, made in cells.items():
            if made:
                sheet(made, a.sheet / f"{split}.png")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
