"""A narrow kitchen: patterned tiles, stone worktop, racks of crockery, jars, pans and pendant lamps.

Interior with strong indirect light, visible bulbs, a bright window and many materials; metres, 5 across.
"""

import numpy as np

import textures as tex
from cycles_stage import Stage, diffuse, glass, glow, metal, plastic
from shapes import (
    bar,
    box,
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

RENDERER = "cycles"
SIZE = (312, 208)
REFERENCE_SPP = 320
EXPOSURE = 1.0
CLAMP = 8.0
MAX_DEPTH = 12


def fronts(stage, side, length, paint):
    """A row of cupboards and drawers with knobs, under a stone worktop; `side` -1: left, 1: right."""
    x = 1.25 * side
    turn = -90 * side
    doors, knobs = [], []
    width = 0.55
    for i in range(int(length / width)):
        y = 0.35 + i * width
        parts = [(0.08, 0.75)] if i % 3 else [(0.08, 0.22), (0.34, 0.22), (0.6, 0.23)]
        for z, tall in parts:
            doors.append(
                rounded_box(width - 0.02, 0.03, tall - 0.02, 0.008).turned("z", turn).moved(x - 0.3 * side, y, z)
            )
            doors.append(
                rounded_box(width - 0.16, 0.02, tall - 0.14, 0.008)
                .turned("z", turn)
                .moved(x - 0.325 * side, y, z + 0.06)
            )
            knobs.append(sphere(0.018, 16).moved(x - 0.35 * side, y + (0 if i % 3 == 0 else 0.2), z + tall / 2))
    stage.add(merged(doors), paint)
    stage.add(merged(knobs), metal((0.9, 0.7, 0.35), 0.15))
    stage.add(box(0.58, length, 0.83).moved(x, length / 2 + 0.05, 0.02), diffuse((0.05, 0.05, 0.05)))
    stage.add(
        rounded_box(0.66, length + 0.1, 0.04, 0.012).moved(x, length / 2 + 0.05, 0.85),
        plastic(tex.terrazzo(1024, 40 + side, (0.5, 0.48, 0.45)), 0.08, repeat=1.1),
    )


def build():
    rng = np.random.default_rng(33)
    stage = Stage()
    stage.add(
        quad(3.2, 6.5).moved(0, 2.0, 0),
        plastic(
            tex.ornament(1024, 5, [(0.6, 0.57, 0.5), (0.08, 0.09, 0.12), (0.5, 0.2, 0.1), (0.35, 0.36, 0.34)], 12),
            0.15,
            repeat=0.9,
        ),
    )
    stage.add(quad(3.2, 6.5).turned("x", 180).moved(0, 2.0, 2.5), diffuse((0.78, 0.77, 0.74)))
    plaster = diffuse(np.asarray((0.62, 0.6, 0.52)) * (0.9 + 0.2 * tex.noise(256, 1.2, 2))[..., None], repeat=0.5)
    for side in (-1, 1):
        stage.add(quad(6.5, 2.5).turned("x", 90).turned("z", -90 * side).moved(1.58 * side, 2.0, 1.25), plaster)
        splash = quad(4.4, 0.55).turned("x", 90).turned("z", -90 * side).moved(1.575 * side, 2.4, 1.18)
        stage.add(
            splash,
            plastic(tex.bricks(1024, 12, 6, (0.2, 0.42, 0.4), (0.7, 0.7, 0.66), 4 + side, 0.06), 0.04, repeat=1.2),
        )
    stage.add(quad(3.2, 2.5).turned("x", 90).turned("z", 180).moved(0, -1.24, 1.25), plaster)
    for width, height, x, z in (
        (1.05, 2.5, -1.05, 1.25),
        (1.05, 2.5, 1.05, 1.25),
        (1.06, 1.0, 0, 0.5),
        (1.06, 0.35, 0, 2.33),
    ):
        stage.add(quad(width, height).turned("x", 90).moved(x, 5.2, z), plaster)
    white = diffuse((0.75, 0.74, 0.7))
    stage.add(
        merged(
            [box(0.05, 0.06, 1.16).moved(x, 5.2, 1.0) for x in (-0.52, 0, 0.52)]
            + [box(1.1, 0.06, 0.05).moved(0, 5.2, z) for z in (1.0, 1.55, 2.13)]
            + [box(1.3, 0.25, 0.04).moved(0, 5.1, 0.96)]
        ),
        white,
    )
    # Evening sky as a bright surface outside, and a slatted blind that cuts it.
    stage.add(quad(2.2, 1.9).turned("x", 90).moved(0, 5.7, 1.7), glow((0.75, 0.87, 1.0), 7.0))
    stage.add(merged([quad(1.06, 0.05).turned("x", 35).moved(0, 5.12, 2.12 - 0.055 * i) for i in range(9)]), white)

    fronts(stage, -1, 4.6, plastic((0.09, 0.2, 0.19), 0.25))
    fronts(stage, 1, 4.6, plastic((0.09, 0.2, 0.19), 0.25))

    # Open shelves with crockery on the left, jars and books on the right.
    oak = plastic(tex.wood(512, 4, (0.5, 0.3, 0.14), (0.28, 0.14, 0.06)), 0.2, repeat=1.0)
    stage.add(merged([box(0.26, 3.6, 0.03).moved(1.44 * s, 2.3, z) for s in (-1, 1) for z in (1.5, 1.88)]), oak)
    bowl = lathe(
        [(0, 0), (0.03, 0), (0.035, 0.012), (0.075, 0.06), (0.08, 0.075), (0.074, 0.075), (0.03, 0.02), (0, 0.018)], 32
    )
    plate = lathe([(0, 0.004), (0.06, 0.004), (0.12, 0.016), (0.12, 0.02), (0.06, 0.01), (0, 0.01)], 40)
    cup = lathe([(0, 0), (0.028, 0), (0.036, 0.03), (0.04, 0.085), (0.037, 0.085), (0.03, 0.01), (0, 0.008)], 28)
    glazes = [
        plastic(c, 0.04)
        for c in ((0.7, 0.68, 0.62), (0.06, 0.14, 0.32), (0.55, 0.25, 0.08), (0.25, 0.36, 0.28), (0.6, 0.12, 0.08))
    ]
    painted = plastic(
        tex.ornament(512, 3, [(0.7, 0.7, 0.68), (0.06, 0.12, 0.4), (0.7, 0.7, 0.68), (0.5, 0.1, 0.08)], 1),
        0.04,
        repeat=3,
    )
    for z in (1.53, 1.91):
        y = 0.62
        while y < 4.0:
            kind, x = rng.integers(4), -1.44 + rng.uniform(-0.03, 0.03)
            glaze = painted if rng.uniform() < 0.3 else glazes[rng.integers(5)]
            if kind == 0:
                stage.add(scattered(bowl, [(x, y, z + 0.028 * k) for k in range(rng.integers(2, 6))]), glaze)
            elif kind == 1:
                stage.add(scattered(plate, [(x, y, z + 0.016 * k) for k in range(rng.integers(3, 9))]), glaze)
            elif kind == 2:
                stage.add(
                    scattered(cup, [(x + dx, y + dy, z) for dx in (-0.045, 0.045) for dy in (-0.045, 0.045)]), glaze
                )
            else:
                stage.add(plate.turned("y", 78).moved(x - 0.06, y, z + 0.12), painted)
            y += 0.27
    for z in (1.53, 1.91):
        y = 0.6
        while y < 4.0:
            tall = rng.uniform(0.13, 0.24)
            r = rng.uniform(0.045, 0.065)
            if rng.uniform() < 0.65:
                stage.add(
                    lathe([(0, 0), (r, 0), (r, tall), (r * 0.8, tall + 0.015), (r * 0.8, tall + 0.03)], 28).moved(
                        1.43, y, z
                    ),
                    glass(),
                )
                stage.add(
                    lathe(
                        [(0, 0.006), (r * 0.93, 0.006), (r * 0.93, tall * rng.uniform(0.4, 0.85)), (0, tall * 0.6)], 24
                    ).moved(1.43, y, z),
                    diffuse(
                        tex.gravel(
                            128, int(rng.integers(99)), [rng.uniform(0.05, 0.6, 3) * (1, 0.7, 0.4) for _ in range(3)]
                        ),
                        repeat=2,
                    ),
                )
                stage.add(cylinder(r * 0.86, 0.025, 24).moved(1.43, y, z + tall + 0.03), oak)
            else:
                covers = box(0.16, 0.2, 0.24)
                covers.uv = np.stack([covers.v[:, 1] / 0.2 + 0.5, 1 - covers.v[:, 2] / 0.24], 1)
                stage.add(
                    covers.moved(1.43, y, z),
                    diffuse(
                        tex.spines(
                            256,
                            300,
                            6,
                            int(rng.integers(99)),
                            [(0.5, 0.08, 0.05), (0.6, 0.55, 0.4), (0.05, 0.15, 0.25), (0.5, 0.35, 0.06)],
                        )
                    ),
                )
                y += 0.08
            y += 0.16

    # A rail of pans and ladles, things on the worktops.
    copper, steel, iron = (
        metal((0.95, 0.55, 0.38), 0.16),
        metal((0.75, 0.75, 0.77), 0.22),
        metal((0.12, 0.12, 0.13), 0.4),
    )
    stage.add(tube([(-1.5, 0.5, 1.4), (-1.5, 4.2, 1.4)], 0.012, 10), steel)
    pan = lathe([(0, 0), (0.1, 0), (0.13, 0.05), (0.125, 0.05), (0.097, 0.006), (0, 0.006)], 40)
    for i in range(7):
        y = 0.8 + i * 0.5
        stage.add(pan.scaled(0.7 + 0.1 * (i % 3)).turned("y", 84).moved(-1.5, y, 1.18), [copper, iron, steel][i % 3])
        stage.add(bar((-1.49, y, 1.25), (-1.49, y, 1.4), 0.014, 0.006), steel)
        stage.add(tube([(-1.48, y + 0.22, 1.4), (-1.48, y + 0.22, 1.16), (-1.46, y + 0.22, 1.12)], 0.006, 8), steel)
        stage.add(sphere(0.028, 16).scaled(0.5, 1, 1).moved(-1.46, y + 0.22, 1.1), steel)
    stage.add(
        lathe(
            [(0, 0), (0.11, 0), (0.12, 0.02), (0.12, 0.14), (0.06, 0.2), (0.02, 0.21), (0.025, 0.24), (0, 0.24)], 40
        ).moved(-1.2, 1.2, 0.89),
        metal((0.8, 0.8, 0.8), 0.05),
    )
    stage.add(tube([(-1.08, 1.2, 1.0), (-0.98, 1.2, 1.05), (-0.95, 1.2, 1.1)], 0.016, 10), metal((0.8, 0.8, 0.8), 0.05))
    stage.add(
        rounded_box(0.3, 0.42, 0.025, 0.01).turned("z", 12).moved(-1.2, 1.8, 0.89),
        plastic(tex.planks(256, 6, 2), 0.3, repeat=3),
    )
    stage.add(
        scattered(
            sphere(0.038, 20), [(-1.2 + rng.uniform(-0.1, 0.1), 1.8 + rng.uniform(-0.14, 0.14), 0.95) for _ in range(9)]
        ),
        plastic((0.6, 0.08, 0.03), 0.08),
    )
    stage.add(
        merged(
            [
                leaf(0.14, 0.05, 0.3)
                .turned("y", -rng.uniform(10, 80))
                .turned("z", rng.uniform(0, 360))
                .moved(1.2, 1.25, 1.03 + rng.uniform(0, 0.08))
                for _ in range(60)
            ]
        ),
        plastic((0.07, 0.22, 0.04), 0.3),
    )
    stage.add(
        lathe([(0, 0), (0.06, 0), (0.08, 0.13), (0.07, 0.13), (0.06, 0.1), (0, 0.1)], 32).moved(1.2, 1.25, 0.89),
        plastic((0.5, 0.2, 0.1), 0.5),
    )
    for i in range(5):
        stage.add(
            lathe(
                [(0, 0), (0.035, 0), (0.037, 0.01), (0.037, 0.16), (0.014, 0.21), (0.013, 0.27), (0, 0.27)], 24
            ).moved(1.35 - 0.06 * (i % 2), 1.7 + 0.13 * i, 0.89),
            [glass((0.25, 0.5, 0.2)), glass((0.85, 0.7, 0.25)), plastic((0.4, 0.05, 0.03), 0.05)][i % 3],
        )
    stage.add(bowl.scaled(1.8).moved(1.15, 2.5, 0.89), painted)
    stage.add(
        scattered(
            sphere(0.042, 20),
            [
                (1.15 + rng.uniform(-0.07, 0.07), 2.5 + rng.uniform(-0.07, 0.07), 0.97 + rng.uniform(0, 0.05))
                for _ in range(8)
            ],
        ),
        plastic((0.7, 0.45, 0.03), 0.2),
    )
    stage.add(rounded_box(0.5, 0.55, 0.01, 0.004).moved(1.22, 3.4, 0.892), plastic((0.01, 0.01, 0.012), 0.03))
    # A table at the near end, with a newspaper, a chequered cloth and a colander.
    stage.add(box(0.9, 0.7, 0.03).moved(0.05, 0.55, 0.72), oak)
    stage.add(
        merged([box(0.05, 0.05, 0.72).moved(0.05 + a, 0.55 + b, 0) for a in (-0.4, 0.4) for b in (-0.3, 0.3)]), oak
    )
    cloth = surface(
        lambda u, v: np.stack([(u - 0.5) * 0.7, (v - 0.5) * 0.5, 0.004 * np.sin(17 * u + 3 * v) + 0.006], 1), 40, 20
    )
    stage.add(
        cloth.turned("z", 9).moved(0.1, 0.58, 0.755),
        diffuse(
            tex.weave(512, 120, (1, 1, 1), (0.8, 0.8, 0.8))
            * tex.checker(512, 8, (0.75, 0.72, 0.66), (0.55, 0.08, 0.06))
        ),
    )
    paper = quad(0.3, 0.4)
    paper.uv = paper.uv / [0.3, -0.4] + [0, 1]
    stage.add(paper.turned("z", -22).moved(-0.2, 0.5, 0.77), diffuse(tex.page(640, 850, 5, line=22)))
    stage.add(cup.scaled(1.2).moved(0.02, 0.42, 0.768), painted)
    a = np.linspace(0, np.pi / 2, 12)
    sieve = merged(
        [ring(0.13 * np.cos(t), 0.004, 48, 6).moved(z=0.13 - 0.12 * np.sin(t)) for t in a[:-1]]
        + [
            tube(
                np.stack([0.13 * np.cos(a) * np.cos(p), 0.13 * np.cos(a) * np.sin(p), 0.13 - 0.12 * np.sin(a)], 1),
                0.003,
                5,
            )
            for p in np.linspace(0, 6.2832, 33)[:-1]
        ]
    )
    stage.add(sieve.moved(0.28, 0.62, 0.765), steel)

    # Three pendant lamps with visible bulbs, and a warm strip under the right shelf.
    for y in (0.9, 2.3, 3.7):
        stage.add(tube([(0, y, 2.5), (0, y, 2.12)], 0.005, 6), iron)
        stage.add(
            lathe([(0.16, 0), (0.13, 0.06), (0.04, 0.13), (0.02, 0.16)], 40).moved(0, y, 1.96),
            plastic((0.55, 0.15, 0.05), 0.15),
        )
        stage.add(sphere(0.035, 20).moved(0, y, 1.98), glow((1.0, 0.75, 0.45), 110.0))
    stage.add(box(0.03, 3.2, 0.012).moved(1.4, 2.3, 1.484), glow((1.0, 0.8, 0.55), 9.0))
    stage.camera((-0.12, -1.0, 1.62), (0.02, 2.0, 1.14), 66)
    return stage
