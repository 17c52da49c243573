"""A market square under sun and clouds: stone, plaster, awnings, tiles, domes of gilded copper, a pool.

Environment light from a high-dynamic-range sky with a small sun, many materials; metres, 400 across.
"""

import numpy as np

import sky
import textures as tex
from mitsuba_stage import Stage, diffuse, glass, metal, plastic
from shapes import (
    Mesh,
    bar,
    box,
    lathe,
    merged,
    quad,
    ring,
    scattered,
    sphere,
    surface,
    tube,
)

RENDERER = "mitsuba"
SIZE = (320, 208)
REFERENCE_SPP = 1024
EXPOSURE = 1.5
CLAMP = 10.0
MAX_DEPTH = 10

PLASTER = [
    (0.7, 0.45, 0.25),
    (0.65, 0.58, 0.45),
    (0.5, 0.22, 0.14),
    (0.55, 0.5, 0.5),
    (0.7, 0.6, 0.3),
    (0.4, 0.45, 0.42),
]


def house(width, depth, height, floors, bays):
    """(walls, trim, panes, roof) of a house whose front looks to -Y."""
    walls = [box(width, depth, height)]
    trim, panes = [box(width + 0.8, depth + 0.8, 0.5).moved(z=height)], []
    for floor in range(floors):
        z = 1.2 + floor * height / floors
        trim.append(box(width + 0.3, depth + 0.3, 0.25).moved(z=z - 1.1))
        for bay in range(bays):
            x = (bay + 0.5) / bays * width - width / 2
            w, h = width / bays * 0.45, height / floors * 0.55
            panes.append(quad(w, h).turned("x", 90).moved(x, -depth / 2 - 0.05, z + h / 2))
            trim += [bar((x + s * w / 2, -depth / 2, z), (x + s * w / 2, -depth / 2, z + h), 0.3) for s in (-1, 0, 1)]
            trim += [
                box(w + 0.9, 0.7, 0.25).moved(x, -depth / 2, z - 0.25),
                box(w + 0.7, 0.5, 0.3).moved(x, -depth / 2, z + h),
            ]
    w, d, r = width / 2 + 0.7, depth / 2 + 0.7, min(width, depth) * 0.42
    v = np.array([(-w, -d, 0), (w, -d, 0), (w, d, 0), (-w, d, 0), (-w, 0, r), (w, 0, r)], float)
    roof = []
    for face, across in (((0, 1, 5, 4), 2 * w), ((2, 3, 4, 5), 2 * w)):
        slope = np.hypot(d, r)
        roof.append(
            Mesh(
                v[list(face)],
                np.array([[0, 1, 2], [0, 2, 3]]),
                np.array([(0, 0), (across, 0), (across, slope), (0, slope)], float),
            )
        )
    gables = Mesh(v[[0, 4, 3, 1, 2, 5]], np.array([[0, 1, 2], [3, 4, 5]]), v[[0, 4, 3, 1, 2, 5]][:, 1:])
    return (
        merged([*walls, gables.moved(z=height + 0.5)]),
        merged(trim),
        merged(panes),
        merged(roof).moved(z=height + 0.5),
    )


def build():
    rng = np.random.default_rng(3)
    stage = Stage()
    stage.environment(sky.sun_and_sky(256, 52, 13, (9000, 6500, 3600), 1.6, clouds=0.8, seed=4))
    stage.add(
        quad(600, 600), diffuse(tex.bricks(1024, 24, 14, (0.42, 0.38, 0.32), (0.16, 0.14, 0.12), 3, 0.1), repeat=1 / 18)
    )
    stage.add(
        quad(44, 44).turned("z", 12).moved(4, 42, 0.05),
        diffuse(
            tex.ornament(1024, 6, [(0.6, 0.55, 0.45), (0.3, 0.12, 0.08), (0.2, 0.2, 0.22), (0.55, 0.4, 0.2)], 5),
            repeat=1 / 22,
        ),
    )

    # Houses around the square; the pattern of each wall is one of three.
    glass_dark = plastic((0.03, 0.04, 0.05))
    roof = diffuse(tex.bricks(512, 16, 12, (0.5, 0.17, 0.08), (0.1, 0.05, 0.03), 7, 0.14), repeat=1 / 6)
    trim = diffuse(tex.mix((0.6, 0.57, 0.5), (0.42, 0.4, 0.35), tex.noise(256, 1.0, 3)), repeat=1 / 8)
    wear = tex.noise(512, 1.2, 17)
    walls = [diffuse(np.asarray(c) * (0.55 + 0.8 * wear)[..., None], repeat=1 / 25) for c in PLASTER]
    walls[2] = diffuse(tex.bricks(512, 16, 8, (0.5, 0.2, 0.13), (0.55, 0.52, 0.46), 9), repeat=1 / 5)
    rows = [(x, 118 + 8 * rng.uniform(), 0) for x in range(-105, 120, 23)]
    rows += [(-78 - 5 * rng.uniform(), y, 78) for y in range(-10, 110, 24)] + [
        (84 + 5 * rng.uniform(), y, -80) for y in range(10, 110, 24)
    ]
    for i, (x, y, turn) in enumerate(rows):
        floors = int(rng.integers(3, 6))
        parts = house(
            rng.uniform(17, 22), rng.uniform(14, 22), floors * rng.uniform(4.2, 5), floors, int(rng.integers(3, 6))
        )
        for mesh, material in zip(parts, (walls[i % len(walls)], trim, glass_dark, roof)):
            stage.add(mesh.turned("z", turn).moved(x, y, 0), material)

    # A church with gilded domes behind, and hills.
    for x, y, s in ((-8, 165, 1.0), (22, 160, 0.62), (-38, 162, 0.62)):
        stage.add(
            lathe([(13, 0), (13, 38), (14.5, 39), (14.5, 41), (12, 42), (12, 48)], 8).scaled(s).moved(x, y, 0), walls[1]
        )
        stage.add(
            lathe([(12, 48), (15, 53), (14, 60), (8, 67), (3, 71), (1.2, 76), (0.6, 80), (0, 84)])
            .scaled(s)
            .moved(x, y, 0),
            metal("Au", 0.16),
        )

    def hill(u, v):
        x, y = (u - 0.5) * 1100, 200 + v * 330
        h = 75 * np.sin(2.1 * u * np.pi) ** 2 * v + 26 * np.sin(13 * u + 4 * v) * v + 12 * np.sin(31 * u + 3) * v
        return np.stack([x, y, np.maximum(h, -1)], 1)

    stage.add(
        surface(hill, 80, 24),
        diffuse(
            tex.ramp(
                tex.noise(512, 0.9, 31), [(0.06, 0.12, 0.03), (0.2, 0.24, 0.08), (0.1, 0.16, 0.06), (0.34, 0.3, 0.16)]
            ),
            repeat=4,
        ),
    )

    # A fountain: stone basin, water, bronze figure of stacked rings.
    stone = diffuse(tex.marble(512, 5), repeat=2)
    stage.add(lathe([(9, 0), (9, 1.6), (8, 1.6), (8, 0.4)], 12).moved(4, 42, 0), stone)
    stage.add(
        surface(
            lambda u, v: np.stack(
                [
                    8 * v * np.cos(6.2832 * u),
                    8 * v * np.sin(6.2832 * u),
                    1.2 + 0.05 * np.sin(22 * v + 3 * np.sin(6.28 * 3 * u)),
                ],
                1,
            ),
            64,
            48,
        ).moved(4, 42, 0),
        plastic((0.02, 0.09, 0.09)),
    )
    stage.add(
        lathe([(1.6, 0), (1, 3), (0.8, 5), (4, 6), (4.2, 6.4), (0.7, 6.2), (0.5, 8.5), (2, 9), (0, 9.2)]).moved(
            4, 42, 0
        ),
        stone,
    )
    stage.add(
        merged([ring(1.3, 0.22).turned("x", a).turned("z", a * 2).moved(4, 42, 10.6) for a in (0, 60, 120)]),
        metal("Cu", 0.2),
    )

    # Market stalls: striped awnings over crates of fruit.
    awnings = [
        tex.stripes(256, [(0.75, 0.72, 0.66), c], 5)
        for c in ((0.6, 0.07, 0.05), (0.05, 0.25, 0.4), (0.1, 0.35, 0.12), (0.7, 0.45, 0.05))
    ]
    crate = diffuse(tex.planks(256, 5, 60), repeat=0.6)
    fruit = [
        plastic(c, 0.12)
        for c in ((0.65, 0.08, 0.04), (0.7, 0.4, 0.03), (0.25, 0.45, 0.06), (0.3, 0.05, 0.15), (0.75, 0.65, 0.1))
    ]
    poles = []
    for i in range(15):
        x, y = [-34, -20, -6, 22, 37][i % 5] + rng.uniform(-3, 3), (2, 22, 74)[i // 5] + rng.uniform(-4, 4)
        roof_cloth = surface(
            lambda u, v: np.stack(
                [
                    (u - 0.5) * 8,
                    (v - 0.5) * 6,
                    3.6 + 1.4 * (1 - np.abs(2 * v - 1) ** 1.5) - 0.15 * np.cos(16 * np.pi * u) * np.abs(2 * v - 1),
                ],
                1,
            ),
            48,
            12,
        )
        turn = rng.uniform(-14, 14)
        stage.add(roof_cloth.turned("z", turn).moved(x, y, 0), diffuse(awnings[i % 4]))
        poles += [tube([(x + a, y + b, 0), (x + a, y + b, 3.8)], 0.1, 6) for a in (-3.6, 3.6) for b in (-2.6, 2.6)]
        for k in range(5):
            cx, cy = x + (k - 2) * 1.5, y - 1.6
            stage.add(box(1.3, 1.6, 1.0).moved(cx, cy, 0), crate)
            heap = np.stack(
                [cx + rng.uniform(-0.55, 0.55, 16), cy + rng.uniform(-0.7, 0.7, 16), 1.02 + rng.uniform(0, 0.35, 16)], 1
            )
            stage.add(scattered(sphere(0.2, 12), heap), fruit[(i + k) % 5])
    stage.add(merged(poles), metal("Al", 0.2))

    # Lamp posts, bollards with chains, a lime tree's worth of leaves in tubs.
    post = lathe([(0.5, 0), (0.3, 0.6), (0.12, 1.2), (0.1, 5.5), (0.35, 5.8), (0.1, 6)])
    places = [(x, y, 0) for x, y in ((-28, -6), (-12, 40), (20, 30), (30, 55), (-30, 60), (44, 8))]
    iron = metal("Cr", 0.3, tint=(0.3, 0.32, 0.3))
    stage.add(scattered(post, places), iron)
    stage.add(scattered(sphere(0.55), np.add(places, (0, 0, 6.4))), glass())
    bollards = [(-44 + 6 * i, -9, 0) for i in range(16)]
    stage.add(scattered(lathe([(0.4, 0), (0.3, 1), (0.42, 1.2), (0, 1.6)], 16), bollards), iron)
    t = np.linspace(0, 1, 12)
    stage.add(
        merged(
            [tube(np.stack([x + 6 * t, y + 0 * t, 1.2 - 2.4 * t * (1 - t)], 1), 0.07, 6) for x, y, _ in bollards[:-1]]
        ),
        iron,
    )
    stage.camera((-16, -44, 17), (3, 60, 6), 56)
    return stage
