#!/usr/bin/env python3
"""Render the corpus of made scenes: every scene at 1, 2, 4, 16 and 64 samples, and its reference.

python3 scenes/corpus/render.py                      what is missing of seeds.txt, into data/corpus
python3 scenes/corpus/render.py --scene room_003     only this scene (repeatable)
python3 scenes/corpus/render.py --preview /tmp/x     few samples, a PNG for each scene, no data
"""

import argparse
import fcntl
import importlib
import os
import sys
import time
import traceback
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

import exr  # noqa: E402
import measure  # noqa: E402

COUNTS = (1, 2, 4, 16, 64)
VECTORS = {"Position": "XYZ", "Normal": "XYZ", "Albedo": "RGB", "SecondaryAlbedo": "RGB", "Depth": "Z", "Direct": "RGB"}
# A reference is rendered until its own noise is below this share of the error of four samples, or to the limit.
NOISE_GOAL, NOISE_LIMIT, REFERENCE_LIMIT = 0.0085, 0.01, 3072
FIRST_HALF = 128
# Bits of mantissa kept of colours: a rounding of 0.1% and less, of noise of a few percent and more.
NOISY_BITS, REFERENCE_BITS = 7, 9
COLUMNS = [
    *("name", "kind", "seed", "split", "exposure", "reference_spp", "error_4spp", "error_4spp_trimmed"),
    *("reference_noise", "reference_noise_trimmed", "seconds"),
]
# Samples per pixel of one launch: bounds the memory.
CHUNK = 32
PILOT_SPP = 16
# Seeds of the samples, far from each other.
PILOT, NOISY, HALVES = 7, 1_000, (1_000_000, 2_000_000)
FILES = [f"{n}spp.exr" for n in COUNTS] + ["reference.exr"]


def scenes():
    """(name, kind, seed, split, renderer) of every scene; Mitsuba where the list names no renderer."""
    rows = []
    for line in (HERE / "seeds.txt").read_text().splitlines():
        if line.strip() and not line.startswith("#"):
            name, kind, seed, split, *renderer = line.split()
            rows.append((name, kind, int(seed), split, *(renderer or ["mitsuba"])))
    return rows


def exposure_for(picture, mean):
    """The exposure that brings the picture's mean, without the glare of lamps, to `mean`; two digits are kept.

    A rough number, so that another machine's rounding does not change it.
    """
    exposure = 1.0
    for _ in range(12):
        exposure *= mean / max(np.minimum(picture * exposure, 1.5).mean(), 1e-9)
    return float(f"{exposure:.1e}")


def nested(samples, exposure):
    """The channels of the first n samples, for each count: means and sample variances of those means."""
    stacks = {k: v * exposure if k in "RGB" or k.startswith("Direct") else v for k, v in samples.items()}
    out = {}
    for n in COUNTS:
        channels = {k: v[:n].mean(0, dtype=np.float64) for k, v in stacks.items()}
        if n > 1:
            variance = {k: v[:n].var(0, ddof=1, dtype=np.float64) / n for k, v in stacks.items()}
            for c in "RGB":
                channels["Variance." + c] = variance[c]
            for feature, components in VECTORS.items():
                channels[feature + ".Variance"] = np.mean([variance[f"{feature}.{c}"] for c in components], 0)
        out[n] = channels
    return out


class Half:
    """A growing mean of samples."""

    def __init__(self, render, seed, exposure):
        self.render, self.seed, self.exposure = render, seed, exposure
        self.total, self.count = 0.0, 0

    def upto(self, count):
        while self.count < count:
            now = min(CHUNK, count - self.count)
            self.total = self.total + now * self.render.colour(now, self.seed + self.count)
            self.count += now
        return self.total / self.count * self.exposure


def reference(render, exposure, colour):
    """Two independent halves, each the mean of `spp / 2` samples."""
    halves = [Half(render, seed, exposure) for seed in HALVES]
    count = FIRST_HALF
    while True:
        means = [h.upto(count) for h in halves]
        error, own = measure.relmse(colour, sum(means) / 2), measure.reference_noise(*means)
        share = max(own[0] / error[0], own[1] / error[1])
        if share <= 0.0098 or count >= REFERENCE_LIMIT // 2:
            return means, 2 * count
        count = min(int(count * share / NOISE_GOAL) // CHUNK * CHUNK + CHUNK, 4 * count, REFERENCE_LIMIT // 2)


def save(path, channels):
    """Whole or not at all; what is there stays."""
    if path.exists():
        return
    part = path.with_suffix(".part.exr")
    exr.write(part, channels, compact=NOISY_BITS if "Direct.R" in channels else REFERENCE_BITS)
    os.replace(part, path)


def notes(out):
    """Name -> row of the table of all scenes."""
    table = out / "scenes.tsv"
    lines = table.read_text().splitlines()[1:] if table.exists() else []
    return {line.split("\t")[0]: dict(zip(COLUMNS, line.split("\t"))) for line in lines}


def note(out, row):
    """Put one row into the table; other processes may do the same."""
    with (out / "scenes.tsv.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        rows = notes(out) | {row[0]: dict(zip(COLUMNS, map(str, row)))}
        lines = ["\t".join(COLUMNS)] + ["\t".join(rows[name].values()) for name in sorted(rows)]
        part = out / "scenes.tsv.part"
        part.write_text("\n".join(lines) + "\n")
        os.replace(part, out / "scenes.tsv")


def fit(counts):
    """Whether a scene is worth its place, judged by its samples alone.

    Not fit: pictures that hardly differ from their noise or have next to none, that are nothing but lamps, or all
    of one tone.
    """
    many, few = (measure.planes(counts[n], "") for n in (64, 4))
    error = measure.relmse(few, many)[1]
    shown = np.clip(many, 0, 1).mean(-1) ** 0.45
    return 0.004 < error < 1.8 and many.mean() < 1.5 and shown.std() > 0.05


def render_scene(name, kind, seed, split, renderer, out, preview=None, choosy=False):
    """Render into files; gives False, and leaves nothing, where a `choosy` caller would not want the scene."""
    module = importlib.import_module("corpus.in_cycles" if renderer == "cycles" else "mitsuba_stage")
    from corpus.scenery import generate

    start = time.time()
    made = generate(kind, seed, module.Stage)
    render = module.Renderer(made.stage, made.size, 0, made.max_depth)
    pilot = render.colour(PILOT_SPP, PILOT)
    # Another machine's rounding could tip a digit of the exposure: the table has the last word.
    known = {} if choosy else notes(out).get(name, {})
    exposure = float(known.get("exposure", 0)) or exposure_for(pilot, made.mean)
    render.set_clamp(made.clamp / exposure)
    render.expose_lamps(exposure)
    if preview:
        samples = render.each(4, NOISY)
        picture = render.colour(32, HALVES[0]) * exposure
        channels = {k: v.mean(0) for k, v in samples.items()}
        error = measure.relmse(measure.planes(channels, "") * exposure, picture)
        for k in [*"RGB", "Direct.R", "Direct.G", "Direct.B"]:
            channels[k] = channels[k] * exposure
        measure.contact_sheet(Path(preview) / f"{name}.png", channels, picture)
        bad = [k for k, v in samples.items() if not np.isfinite(v).all()]
        print(
            f"{name} {made.size[0]}x{made.size[1]} exposure {exposure:.2g}, error about {error[1]:.3f}, "
            f"mean {picture.mean():.2f}, {time.time() - start:.0f} s{f', not finite: {bad}' if bad else ''}",
            flush=True,
        )
        return True
    counts = nested(render.each(COUNTS[-1], NOISY), exposure)
    colour = measure.planes(counts[4], "")
    if choosy and not fit(counts):
        return False
    folder = out / split / name
    if known and (folder / "reference.exr").exists():
        # Only other sample counts are missing.
        for n, channels in counts.items():
            save(folder / f"{n}spp.exr", channels)
        print(f"{name}: samples only, {time.time() - start:.0f} s", flush=True)
        return True
    halves, spp = reference(render, exposure, colour)
    mean = (halves[0] + halves[1]) / 2
    folder.mkdir(parents=True, exist_ok=True)
    for n, channels in counts.items():
        save(folder / f"{n}spp.exr", channels)
    # The reference comes last: a scene that has one is complete.
    save(folder / "reference.exr", dict(zip("RGB", np.moveaxis(mean, -1, 0))))
    error, own = measure.relmse(colour, mean), measure.reference_noise(*halves)
    seconds = time.time() - start
    shares = [own[i] / max(error[i], 1e-12) for i in (0, 1)]
    numbers = [f"{x:.4f}" for x in (*error, *shares)]
    note(out, [name, kind, seed, split, exposure, spp, *numbers, f"{seconds:.0f}"])
    print(
        f"{name} {made.size[0]}x{made.size[1]} {spp} spp, error {error[0]:.3f} ({error[1]:.3f}), reference's noise "
        f"{shares[0]:.2%} ({shares[1]:.2%}), mean {mean.mean():.3f}, {seconds:.0f} s",
        flush=True,
    )
    if choosy and max(shares) > NOISE_LIMIT:
        return False
    return True


def use_threads(count, rows):
    """Keep the renderers of these scenes to so many threads (0: all cores)."""
    if not count:
        return
    import drjit as dr

    dr.set_thread_count(count)
    if any(row[4] == "cycles" for row in rows):
        from corpus import in_cycles

        in_cycles.Renderer.threads = count


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", action="append", help="render only this one (repeatable)")
    parser.add_argument("--kind", action="append", help="render only this kind (repeatable)")
    parser.add_argument(
        "--out", type=Path, default=HERE.parents[1] / "data/corpus", help="folder for train/ and validate/"
    )
    parser.add_argument(
        "--share", default="0/1", help="i/n: every n-th missing scene, from the i-th, for n jobs at once"
    )
    parser.add_argument("--threads", type=int, default=0, help="threads of one job; 0: all cores")
    parser.add_argument("--list", action="store_true", help="only name the scenes that are missing")
    parser.add_argument("--preview", metavar="DIR", help="write PNGs at few samples instead of data")
    a = parser.parse_args()
    todo = [s for s in scenes() if (not a.scene or s[0] in a.scene) and (not a.kind or s[1] in a.kind)]
    if not a.preview:
        todo = [s for s in todo if not all((a.out / s[3] / s[0] / f).exists() for f in FILES)]
    index, jobs = map(int, a.share.split("/"))
    todo = todo[index::jobs]
    if a.list:
        print("\n".join(s[0] for s in todo))
        return
    use_threads(a.threads, todo)
    for row in todo:
        try:
            render_scene(*row, a.out, a.preview)
        except Exception:
            # One broken scene does not stop the rest.
            print(f"{row[0]} failed", flush=True)
            traceback.print_exc()


if __name__ == "__main__":
    main()
