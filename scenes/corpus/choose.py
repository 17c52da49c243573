#!/usr/bin/env python3
"""Draw the list of scenes: for every place in it the first seed whose scene is fit, rendered on the way.

python3 scenes/corpus/choose.py      goes on where seeds.txt ends

A scene is fit by its own noise and tones (see render.fit) and if its reference becomes clean enough. No filter's result
has a say. With another list every trained filter's data changes, so this is for making a new corpus only.
"""

import argparse
import shutil
import sys
import traceback
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from corpus import render  # noqa: E402

# How many scenes of each kind, and how many of them only validate.
PLACES = {
    "room": (16, 3), "plain": (16, 3), "nook": (14, 2), "tabletop": (10, 1), "exterior": (9, 2), "wet": (8, 1),
    "corridor": (8, 1), "gallery": (8, 1), "closeup": (8, 1), "landscape": (7, 1), "fine": (7, 1), "dark": (7, 1),
    "stairs": (6, 1), "caustics": (6, 1), "street": (6, 1), "abstract": (6, 1), "printed": (5, 1), "night": (5, 1),
}  # fmt: skip
# Some more in Cycles: kind and split.
CYCLES = [
    ("room", "train"), ("tabletop", "train"), ("exterior", "train"), ("plain", "validate"), ("wet", "train"),
    ("gallery", "train"), ("fine", "train"), ("nook", "validate"), ("closeup", "train"), ("corridor", "train"),
]  # fmt: skip


def places():
    """Every place as (name, kind, number, split, renderer); kinds are mixed, so any beginning of the list is too."""
    rows = []
    for kind, (count, held) in PLACES.items():
        for i in range(count):
            split = "validate" if i % 4 == 2 and i // 4 < held else "train"
            rows.append(((i + 0.5) / count, f"{kind}_{i + 1:03d}", kind, i + 1, split, "mitsuba"))
    rows = [row[1:] for row in sorted(rows)]
    return rows + [(f"cycles_{kind}", kind, 101 + i, split, "cycles") for i, (kind, split) in enumerate(CYCLES)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE.parents[1] / "data/corpus")
    parser.add_argument("--threads", type=int, default=0)
    a = parser.parse_args()
    render.use_threads(a.threads, places())
    seeds = HERE / "seeds.txt"
    have = {row[0] for row in render.scenes()}
    for name, kind, number, split, renderer in places():
        if name in have:
            continue
        for attempt in range(8):
            seed = number + 1000 * attempt
            try:
                if render.render_scene(name, kind, seed, split, renderer, a.out, choosy=True):
                    with seeds.open("a") as f:
                        f.write(f"{name} {kind} {seed} {split}{' cycles' if renderer == 'cycles' else ''}\n")
                    break
            except Exception:
                traceback.print_exc()
            shutil.rmtree(a.out / split / name, ignore_errors=True)
            print(f"{name}: seed {seed} is not fit", flush=True)


if __name__ == "__main__":
    main()
