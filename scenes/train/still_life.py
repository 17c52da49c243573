"""Fruit, cups, cards and beads close to the lens: most of the picture is out of focus.

Depth of field makes every feature noisy, over textured objects, small highlights and a
few visible lamps; units of one, 12 across.
"""

import numpy as np

import sky
import textures as tex
from mitsuba_stage import Stage, diffuse, glass, metal, plastic
from shapes import (
    curtain,
    cylinder,
    lathe,
    leaf,
    merged,
    quad,
    ring,
    rounded_box,
    scattered,
    sphere,
    surface,
    tube,
)

RENDERER = "mitsuba"
SIZE = (288, 224)
REFERENCE_SPP = 512
EXPOSURE = 1.0
CLAMP = 10.0
MAX_DEPTH = 12


def build():
    rng = np.random.default_rng(21)
    stage = Stage()
    stage.environment(
        sky.studio(
            256, [(215, 38, 34, 26, (26, 23, 19)), (330, 20, 20, 46, (5, 7, 10)), (100, 55, 50, 16, (4, 4, 4.5))], 0.12
        )
    )
    cloth = tex.weave(1024, 110, (0.62, 0.6, 0.55), (0.5, 0.45, 0.38)) * np.where(
        tex.checker(1024, 8, (1, 1, 1), (0.25, 0.35, 0.6)) > 0.5, 1, 0.55
    )

    def table(u, v):
        x, y = (u - 0.5) * 26, v * 30 - 8
        return np.stack([x, y, 0.05 * np.sin(1.1 * x + 0.4 * y) * np.sin(0.9 * y)], 1)

    stage.add(surface(table, 60, 60), diffuse(cloth, repeat=6))
    stage.add(
        curtain(30, 14, 14, 0.5, rng).moved(0, 20, -1),
        diffuse(
            tex.ornament(768, 3, [(0.3, 0.06, 0.05), (0.45, 0.3, 0.1), (0.16, 0.03, 0.05), (0.5, 0.4, 0.2)], 9),
            repeat=0.25,
        ),
    )

    apple = surface(
        lambda u, v: np.stack(
            [
                np.cos(6.2832 * u) * (0.02 + np.sin(np.pi * v)) * (0.62 + 0.16 * v),
                np.sin(6.2832 * u) * (0.02 + np.sin(np.pi * v)) * (0.62 + 0.16 * v),
                0.58 - 0.62 * np.cos(np.pi * v) - 0.28 * np.exp(-(((1 - v) / 0.13) ** 2)),
            ],
            1,
        ),
        40,
        32,
    )
    for i in range(13):
        place = (rng.uniform(-4.5, 4.5), rng.uniform(-2.5, 12), 0)
        skin = tex.ramp(
            tex.noise(256, 1.3, 300 + i, (1, 3)),
            [
                [(0.5, 0.03, 0.03), (0.6, 0.1, 0.04), (0.7, 0.5, 0.1)],
                [(0.2, 0.4, 0.05), (0.4, 0.5, 0.1), (0.55, 0.5, 0.2)],
            ][i % 2],
        )
        skin[tex.noise(256, 0.4, 400 + i) > 0.78] = (0.7, 0.6, 0.35)
        stage.add(apple.turned("x", rng.uniform(-30, 30)).turned("z", rng.uniform(0, 360)).moved(*place), plastic(skin))
        stage.add(
            tube(np.add([(0, 0, 1.05), (0.03, 0, 1.25), (0.12, 0, 1.45)], place), 0.03, 6), diffuse((0.15, 0.08, 0.03))
        )

    cup = lathe(
        [(0, 0), (0.42, 0), (0.44, 0.08), (0.6, 0.5), (0.66, 1.05), (0.62, 1.05), (0.55, 0.5), (0.38, 0.14), (0, 0.12)]
    )
    blue = tex.ornament(512, 4, [(0.75, 0.76, 0.78), (0.05, 0.12, 0.45), (0.75, 0.76, 0.78), (0.1, 0.2, 0.5)], 2)
    for x, y in ((-1.7, 1.2), (1.2, 3.9), (3.2, 7.4), (-3.1, 6.2)):
        stage.add(cup.moved(x, y, 0.08), plastic(blue, repeat=3))
        stage.add(
            lathe([(0, 0.03), (0.5, 0.03), (1.0, 0.16), (1.0, 0.12), (0.5, 0), (0, 0)]).moved(x, y, 0.05),
            plastic(blue, repeat=6),
        )
        stage.add(ring(0.26, 0.06).turned("x", 90).moved(x + 0.75, y, 0.65), plastic((0.75, 0.76, 0.78)))
    stage.add(
        lathe(
            [
                (0.0, 0.02),
                (0.55, 0.02),
                (0.08, 0.12),
                (0.06, 1.1),
                (0.55, 1.6),
                (0.7, 2.4),
                (0.66, 2.4),
                (0.5, 1.65),
                (0, 1.3),
            ]
        ).moved(0.2, 1.9, 0.03),
        glass(),
    )
    silver = metal("Ag", 0.08)
    stage.add(
        lathe(
            [
                (0.5, 0),
                (0.55, 0.06),
                (0.15, 0.3),
                (0.12, 1.4),
                (0.3, 1.5),
                (0.16, 1.7),
                (0.16, 2.4),
                (0.45, 2.5),
                (0.45, 2.56),
                (0, 2.56),
            ]
        ).moved(-2.3, 3.6, 0),
        silver,
    )
    stage.add(cylinder(0.14, 0.35).moved(-2.3, 3.6, 2.5), plastic((0.7, 0.64, 0.5), 0.3))
    stage.add(
        merged(
            [
                ring(0.22, 0.035).turned("x", rng.uniform(0, 90)).moved(rng.uniform(-3, 3), rng.uniform(-2, 4), 0.15)
                for _ in range(26)
            ]
        ),
        metal("Au", 0.1),
    )
    for i in range(70):
        place = (rng.uniform(-4, 4), rng.uniform(-3, 9), 0.13)
        if i % 3 == 0:
            stage.add(sphere(0.1, 20).moved(*place), silver)
        else:
            stage.add(sphere(0.12, 20).moved(*place), plastic(rng.uniform(0.02, 0.7, 3)))
    for i in range(14):
        card = quad(0.9, 1.3)
        card.uv = card.uv / [0.9, 1.3]
        tilt = rng.uniform(40, 85) if i % 2 else rng.uniform(0, 8)
        stage.add(
            card.turned("x", tilt)
            .turned("z", rng.uniform(-50, 50))
            .moved(rng.uniform(-4, 4), rng.uniform(-2, 9), 0.12 + 0.65 * np.sin(np.radians(tilt))),
            diffuse(
                tex.poster(256, 500 + i, [(0.8, 0.78, 0.7), (0.03, 0.03, 0.05), (0.6, 0.05, 0.05), (0.05, 0.2, 0.5)])
            ),
        )
    spray = [
        leaf(1.3, 0.5, 0.35)
        .turned("y", -rng.uniform(5, 60))
        .turned("z", rng.uniform(0, 360))
        .moved(2.6, 5.6, 0.5 + 2.2 * rng.uniform())
        for _ in range(60)
    ]
    spray += [
        leaf(1.0, 0.42, 0.4)
        .turned("y", -rng.uniform(5, 60))
        .turned("z", rng.uniform(0, 360))
        .moved(-3.2, -0.4, 0.2 + 1.1 * rng.uniform())
        for _ in range(26)
    ]
    stage.add(
        merged(spray),
        plastic(tex.ramp(tex.noise(256, 1.2, 6), [(0.03, 0.1, 0.02), (0.1, 0.22, 0.04), (0.2, 0.3, 0.08)]), 0.1),
    )
    stage.add(rounded_box(1.6, 1.1, 0.5, 0.08).turned("z", 30).moved(2.0, 0.6, 0.03), plastic(tex.wood(512, 4), 0.08))
    # Visible lights: the candle's flame in focus' reach, and a string of small lamps far out of it.
    flame = lathe([(0, 0), (0.09, 0.12), (0.07, 0.28), (0, 0.5)], 16)
    stage.add(flame.moved(-2.3, 3.6, 2.88), diffuse(0.0), glow=(24, 14, 5), share=0.1)
    lamps = [(x, 17.5, 3.2 + 0.45 * np.cos(1.4 * x)) for x in np.arange(-8, 9, 0.9)]
    stage.add(scattered(sphere(0.1, 12), lamps), diffuse(0.0), glow=(14, 10, 6), share=0.1)
    stage.camera((0.2, -7.5, 2.9), (0, 1.8, 0.75), 40, aperture=0.19, focus=(0, 1.6, 0.7))
    return stage
