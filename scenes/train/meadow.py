"""A meadow behind a wattle fence: grass, seed heads, flowers, a wire mesh, a wicker basket, ropes.

Fine geometry, most of it thinner than a pixel, under a low sun; decimetres, about 90 across.
"""

import numpy as np

import sky
import textures as tex
from cycles_stage import Stage, diffuse, metal, plastic
from shapes import (
    bar,
    blades,
    leaf,
    merged,
    scattered,
    sphere,
    surface,
    tube,
)

RENDERER = "cycles"
SIZE = (256, 256)
REFERENCE_SPP = 360
EXPOSURE = 1.0
CLAMP = 10.0
MAX_DEPTH = 10


def ground(x, y):
    return (
        0.9 * np.sin(0.13 * x + 1) * np.cos(0.11 * y)
        + 0.25 * np.sin(0.5 * x) * np.sin(0.43 * y + 2)
        + 0.02 * np.maximum(y - 20, 0) ** 1.4
    )


def lay(x, y, lift=0.0):
    return np.stack([x, y, ground(x, y) + lift], 1)


def build():
    rng = np.random.default_rng(17)
    stage = Stage()
    stage.environment(sky.sun_and_sky(256, 150, 27, (5200, 4200, 2700), 1.6, clouds=0.9, seed=8))
    soil = surface(lambda u, v: lay((u - 0.5) * 120, v * 110 - 20), 90, 90)
    stage.add(
        soil,
        diffuse(
            tex.gravel(512, 3, ((0.16, 0.1, 0.05), (0.08, 0.09, 0.03), (0.22, 0.16, 0.08), (0.06, 0.1, 0.02))), repeat=8
        ),
    )

    # Grass: colour differs from blade to blade (u) and from root to tip (v).
    def lawn(count, near, far, height, width, palette, seed):
        r = np.random.default_rng(seed)
        y = near + (far - near) * r.uniform(0, 1, count) ** 1.6
        x = r.uniform(-1, 1, count) * (9 + 0.62 * (y + 17))
        colours = np.stack(
            [
                tex.ramp(np.linspace(0, 1, 32), [np.multiply(c, 0.35), c, np.multiply(c, 1.3)])
                for c in [
                    np.clip(palette[r.integers(len(palette))] + r.normal(0, 0.025, 3), 0.01, 1) for _ in range(64)
                ]
            ],
            1,
        )
        h = height * r.uniform(0.5, 1.3, count)
        stage.add(blades(lay(x, y), h, width * r.uniform(0.6, 1.2, count), r), diffuse(colours))

    green = [(0.12, 0.3, 0.04), (0.2, 0.36, 0.06), (0.07, 0.22, 0.05), (0.4, 0.38, 0.12)]
    lawn(26000, -16, 80, 2.6, 0.16, green, 1)
    lawn(5000, -10, 50, 5.0, 0.1, [(0.5, 0.42, 0.2), (0.4, 0.4, 0.14)], 2)

    # Seed heads and flowers on thin stalks.
    stalks, heads, petals, hearts = [], [], [], []
    for _ in range(170):
        x, y = rng.uniform(-22, 22), rng.uniform(-9, 30)
        z = ground(x, y)
        tall = rng.uniform(3.5, 7.5)
        dx, dy = rng.normal(0, 0.8, 2)
        top = (x + dx, y + dy, z + tall)
        stalks.append(tube([(x, y, z), (x + dx * 0.3, y + dy * 0.3, z + tall * 0.55), top], [0.06, 0.05, 0.035], 5))
        kind = rng.integers(3)
        if kind == 0:
            heads.append(
                merged(
                    [
                        tube([top, (top[0] + a, top[1] + b, top[2] + c)], [0.05, 0.015], 4)
                        for a, b, c in rng.normal(0, 0.35, (18, 3)) + (0, 0, 0.5)
                    ]
                )
            )
        else:
            flower = (
                merged([leaf(0.62, 0.3, 0.2).turned("z", i * 40) for i in range(9)])
                .turned("x", rng.uniform(20, 80))
                .turned("z", rng.uniform(-60, 60))
            )
            (petals if kind == 1 else hearts).append(flower.moved(*top))
    stage.add(merged(stalks), diffuse((0.14, 0.26, 0.06)))
    stage.add(merged(heads), diffuse((0.5, 0.4, 0.24)))
    stage.add(merged(petals), plastic((0.75, 0.72, 0.7), 0.5))
    stage.add(merged(hearts), plastic((0.62, 0.06, 0.08), 0.4))

    # The fence: posts, woven withies, and a wire mesh hung on it.
    bark = diffuse(tex.ramp(tex.noise(512, 1.0, 5, (1, 8)), [(0.08, 0.05, 0.03), (0.3, 0.2, 0.12), (0.45, 0.36, 0.26)]))
    posts = np.arange(-33, 34, 5.5)
    stage.add(
        merged(
            [
                tube(
                    [
                        (x, 12, -2),
                        (x + rng.normal(0, 0.2), 12, 5),
                        (x, 12 + rng.normal(0, 0.2), 10 + rng.uniform(0, 1.5)),
                    ],
                    0.5,
                    10,
                )
                for x in posts
            ]
        ),
        bark,
    )
    t = np.linspace(-34, 34, 170)
    withies = []
    for i in range(19):
        side = 1 if i % 2 else -1
        path = np.stack(
            [t, 12 + side * 0.62 * np.cos(np.pi * (t + 33) / 5.5), 1.6 + i * 0.42 + 0.1 * np.sin(t * 0.7 + i)], 1
        )
        withies.append(tube(path, 0.17, 6))
    stage.add(merged(withies), bark)
    mesh = [bar((x, 6.4, 0.2), (x - 0.0, 6.4, 6.5), 0.07) for x in np.arange(4, 17, 0.62)]
    mesh += [bar((4, 6.4, z), (16.6, 6.4, z), 0.07) for z in np.arange(0.4, 6.6, 0.62)]
    stage.add(merged(mesh), metal((0.7, 0.7, 0.72), 0.3))

    # A wicker basket with fruit, and a coil of rope.
    def wicker(radius, height, turns, ribs):
        out = []
        for i in range(turns):
            a = np.linspace(0, 2 * np.pi, ribs * 8 + 1)
            r = radius * (0.75 + 0.3 * i / turns) + 0.12 * np.cos(ribs / 2 * a + np.pi * (i % 2))
            out.append(tube(np.stack([r * np.cos(a), r * np.sin(a), 0 * a + height * i / turns], 1), 0.1, 5))
        for a in np.linspace(0, 2 * np.pi, ribs + 1)[:-1]:
            out.append(
                tube(
                    [
                        (0.75 * radius * np.cos(a), 0.75 * radius * np.sin(a), 0),
                        (1.05 * radius * np.cos(a), 1.05 * radius * np.sin(a), height),
                    ],
                    0.09,
                    5,
                )
            )
        h = np.linspace(0, np.pi, 24)
        out.append(tube(np.stack([1.05 * radius * np.cos(h), 0 * h, height + 1.3 * radius * np.sin(h)], 1), 0.16, 6))
        return merged(out)

    z = ground(-6.0, -3.0)
    stage.add(wicker(2.6, 2.6, 14, 22).turned("z", 30).moved(-6, -3, z + 0.8), plastic((0.42, 0.26, 0.1), 0.35))
    fruit = np.stack(
        [-6 + rng.uniform(-1.7, 1.7, 26), -3 + rng.uniform(-1.7, 1.7, 26), z + 2.6 + rng.uniform(0, 1.3, 26)], 1
    )
    stage.add(scattered(sphere(0.62, 24), fruit[:13]), plastic((0.6, 0.07, 0.04), 0.15))
    stage.add(scattered(sphere(0.55, 24), fruit[13:]), plastic((0.6, 0.5, 0.08), 0.15))
    a = np.linspace(0, 2 * np.pi * 9, 500)
    coil = np.stack(
        [7 + (1.9 + 0.1 * np.sin(a * 0.31)) * np.cos(a), -5 + 1.9 * np.sin(a), ground(7.0, -5.0) + 0.7 + a * 0.028], 1
    )
    strands = [
        tube(
            coil
            + 0.14 * np.stack([np.cos(a * 14 + k) * np.cos(a), np.cos(a * 14 + k) * np.sin(a), np.sin(a * 14 + k)], 1),
            0.11,
            5,
        )
        for k in (0, 2.1, 4.2)
    ]
    stage.add(merged(strands), diffuse((0.5, 0.4, 0.26)))
    # Trees beyond, all twigs and leaves.
    twigs, foliage = [], []
    for x, y in ((-26, 44), (-8, 58), (12, 48), (30, 60)):
        base = np.array([x, y, ground(x, y)])
        twigs.append(tube([base, base + (0.5, 0, 9), base + (0, 0.4, 17)], [1.0, 0.7, 0.4], 8))
        for _ in range(70):
            start = base + (0, 0, rng.uniform(6, 17))
            end = start + rng.normal(0, 1, 3) * (5, 4, 3) + (0, 0, 2)
            twigs.append(tube([start, (start + end) / 2 + rng.normal(0, 0.4, 3), end], [0.16, 0.1, 0.03], 4))
            foliage += [
                leaf(1.2, 0.7, 0.2, 3)
                .turned("x", rng.uniform(-70, 70))
                .turned("z", rng.uniform(0, 360))
                .moved(*(end + rng.normal(0, 1.1, 3)))
                for _ in range(14)
            ]
    stage.add(merged(twigs), bark)
    stage.add(merged(foliage), diffuse((0.16, 0.26, 0.05)))
    stage.camera((1.5, -24, 8.5), (0, 8, 3.6), 48)
    return stage
