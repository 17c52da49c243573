"""A table of newspapers, cloth, chequered paper and wood under two soft lamps.

High-frequency textures, most of them flat, so that normals and depth say nothing; soft shadows; centimetres.
"""

import numpy as np

import textures as tex
from mitsuba_stage import Stage, diffuse, metal, plastic
from shapes import (
    bar,
    box,
    lathe,
    merged,
    quad,
    rounded_box,
    sphere,
    surface,
    tube,
)

RENDERER = "mitsuba"
SIZE = (256, 256)
REFERENCE_SPP = 768
EXPOSURE = 1.0
CLAMP = 10.0
MAX_DEPTH = 10


def sheet(width, height, rng, curl):
    """Paper that does not lie quite flat."""
    a, b = rng.uniform(0, 6, 2)

    def shape(u, v):
        z = curl * (0.5 + 0.5 * np.sin(3 * u + a) * np.cos(2.5 * v + b)) + 3 * curl * np.maximum(u - 0.75, 0) ** 2 * 8
        return np.stack([(u - 0.5) * width, (v - 0.5) * height, z], 1)

    m = surface(shape, 24, 24)
    m.uv[:, 1] = 1 - m.uv[:, 1]
    return m


def build():
    rng = np.random.default_rng(12)
    stage = Stage()
    stage.add(quad(160, 120), plastic(tex.planks(1024, 9, 51), 0.15, repeat=1 / 70))
    back = quad(260, 120).turned("x", 90).moved(0, 55, 55)
    stage.add(
        back,
        diffuse(
            tex.tiles(1024, 16, (0.55, 0.57, 0.5), (0.12, 0.3, 0.32), (0.7, 0.7, 0.66), 3)
            * (0.6 + 0.7 * tex.noise(1024, 0.9, 4)[..., None]),
            repeat=1 / 60,
        ),
    )

    for i, (x, y, turn) in enumerate(((-22, -6, 12), (13, -14, -17), (-4, 16, 4), (33, 6, 38), (-38, 20, -24))):
        stage.add(
            sheet(30, 41, rng, 0.5).turned("z", turn).moved(x, y, 0.1 + 0.35 * i),
            diffuse(tex.page(700, 950, i, line=22 + 4 * (i % 3), columns=2 + i % 2)),
        )
    for i, (x, y, turn, pattern) in enumerate(
        (
            (-26, -30, 30, tex.checker(512, 12, (0.8, 0.78, 0.72), (0.03, 0.03, 0.04))),
            (
                34,
                -28,
                8,
                tex.ornament(768, 4, [(0.7, 0.65, 0.5), (0.06, 0.15, 0.35), (0.55, 0.12, 0.05), (0.75, 0.7, 0.6)], 6),
            ),
            (4, -36, -9, tex.dots(512, 14, (0.65, 0.5, 0.08), (0.2, 0.03, 0.1))),
            (20, 30, 60, tex.stripes(512, [(0.7, 0.68, 0.6), (0.1, 0.2, 0.4), (0.5, 0.1, 0.06)], 9)),
            (-12, 38, 15, tex.terrazzo(768, 4)),
        )
    ):
        stage.add(sheet(17, 17, rng, 0.3).turned("z", turn).moved(x, y, 1.9 + 0.2 * i), diffuse(pattern))

    # Books, rolled paper, pencils, a cloth-covered box and marbles: things that cast shadows over print.
    for i, (x, y, turn) in enumerate(((-44, -8, 80), (-43.2, -7.2, 66), (-44.4, -8.5, 92))):
        book = rounded_box(24, 17, 3.4, 0.4).turned("z", turn).moved(x, y, 2.2 + 3.5 * i)
        stage.add(
            book,
            plastic(
                tex.weave(
                    256,
                    40,
                    *[
                        ((0.5, 0.1, 0.07), (0.35, 0.06, 0.05)),
                        ((0.1, 0.2, 0.35), (0.05, 0.1, 0.2)),
                        ((0.6, 0.5, 0.3), (0.3, 0.25, 0.1)),
                    ][i],
                ),
                0.3,
                repeat=1 / 8,
            ),
        )
    stage.add(
        box(15, 12, 13).turned("z", 25).moved(32, 30, 0.4),
        diffuse(tex.weave(512, 30, (0.6, 0.55, 0.4), (0.1, 0.25, 0.2)), repeat=1 / 12),
    )
    stage.add(
        lathe([(3, 0), (3.2, 46), (3.0, 46), (2.8, 0)]).turned("y", 90).turned("z", 35).moved(-34, -42, 5),
        diffuse(tex.page(600, 600, 77, line=20, picture=False)),
    )
    stage.add(
        lathe([(2, 0), (4.4, 0), (5, 11), (4.7, 11), (4.1, 0.6), (0, 0.6)]).moved(13, 12, 1.7),
        plastic(tex.marble(512, 8), 0.05),
    )
    pencils = [(0.55, 0.08, 0.05), (0.65, 0.5, 0.05), (0.05, 0.2, 0.45), (0.08, 0.3, 0.1)]
    for i in range(9):
        a = rng.uniform(0, 6.28)
        top = np.array([13 + 5 * np.cos(a), 12 + 5 * np.sin(a), 19 + rng.uniform(-2, 3)])
        stage.add(
            tube([(13 + 1.5 * np.cos(a), 12 + 1.5 * np.sin(a), 2.5), tuple(top)], 0.42, 6),
            plastic(pencils[i % 4], 0.08),
        )
    for i in range(12):
        x, y = rng.uniform(-34, 34), rng.uniform(-42, 6)
        pattern = tex.ramp(tex.noise(256, 1.5, 200 + i), [rng.uniform(0.02, 0.7, 3) for _ in range(4)])
        stage.add(sphere(rng.uniform(1.1, 1.9), 24).moved(x, y, 3.6), plastic(pattern))
    stage.add(
        merged(
            [
                tube(
                    np.array([(-3, 0, 0), (0, 0.3, 0.2), (3, 0, 0), (3.3, -0.6, 0), (-2.6, -0.7, 0)]) * 0.7
                    + [rng.uniform(-40, 40), rng.uniform(-40, 20), 2.9],
                    0.12,
                    6,
                )
                for _ in range(18)
            ]
        ),
        metal("Cr", 0.1),
    )
    # A hanging lattice between lamp and table breaks the shadows up.
    lattice = [bar((x, -30, 58), (x + 18, 44, 58), 0.9) for x in np.arange(-60, 50, 11)]
    lattice += [bar((-60, y, 59), (60, y + 6, 59), 0.9) for y in np.arange(-30, 46, 12)]
    stage.add(merged(lattice), diffuse((0.3, 0.25, 0.2)))

    stage.add(quad(26, 26).turned("y", 150).moved(-62, -20, 92), diffuse(0.0), glow=(95, 80, 58))
    stage.add(quad(12, 70).turned("x", 180).moved(58, 20, 88), diffuse(0.0), glow=(22, 30, 45))
    stage.camera((4, -74, 56), (0, -5, 2), 52)
    return stage
