"""A courtyard cafe at dusk under strings of bulbs: arcades, tables, pots, washing lines, lanterns.

Some 150 small visible lights and a dim sky, many small objects, brick, ornament, cloth; decimetres, 250 across.
"""

import numpy as np

import sky
import textures as tex
from mitsuba_stage import Stage, diffuse, glass, metal, plastic
from shapes import (
    Mesh,
    bar,
    box,
    cylinder,
    grid,
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
SIZE = (288, 216)
REFERENCE_SPP = 640
EXPOSURE = 1.0
CLAMP = 10.0
MAX_DEPTH = 9


def arch_wall(width, height, thickness, bays, spring, radius):
    """A wall in the XZ plane with round-arched openings, its front at y = 0."""
    pitch = width / bays
    parts = []
    t = np.linspace(0, np.pi, 25)
    for i in range(bays):
        c = -width / 2 + (i + 0.5) * pitch
        x = np.concatenate([[c - pitch / 2], c - radius * np.cos(t), [c + pitch / 2]])
        low = np.concatenate([[spring], spring + radius * np.sin(t), [spring]])
        for y in (0.0, thickness):
            lower = np.stack([x, 0 * x + y, low], 1)
            upper = np.stack([x, 0 * x + y, 0 * x + height], 1)
            v = np.concatenate([lower, upper])
            parts.append(Mesh(v, grid(len(x) - 1, 1), v[:, [0, 2]]))
        soffit = np.concatenate(
            [np.stack([x[1:-1], 0 * t, low[1:-1]], 1), np.stack([x[1:-1], 0 * t + thickness, low[1:-1]], 1)]
        )
        parts.append(Mesh(soffit, grid(len(t) - 1, 1), soffit[:, [0, 1]]))
        for side in (-1, 1):
            pier = box(pitch / 2 - radius, thickness, spring)
            parts.append(pier.moved(c + side * (pitch / 2 + radius) / 2, thickness / 2, 0))
    return merged(parts)


def chair():
    legs = [bar((x, y, 0), (x * 0.9, y * 0.9, 4.5), 0.3) for x in (-1.9, 1.9) for y in (-1.9, 1.9)]
    seat = [bar((-2.1, y, 4.6), (2.1, y, 4.6), 0.5, 0.25) for y in np.linspace(-1.8, 1.8, 6)]
    back = [bar((x, 2.0, 4.5), (x, 2.7, 9), 0.3) for x in (-1.8, 1.8)] + [
        bar((-1.9, 2.2 + 0.2 * i, 6 + i), (1.9, 2.2 + 0.2 * i, 6 + i), 0.55, 0.2) for i in range(4)
    ]
    return merged(legs + seat + back)


def build():
    rng = np.random.default_rng(41)
    stage = Stage()
    stage.environment(
        sky.sun_and_sky(
            128,
            120,
            4,
            (9, 5, 2.5),
            6,
            zenith=(0.14, 0.24, 0.55),
            horizon=(0.75, 0.5, 0.5),
            ground=(0.03, 0.03, 0.03),
            clouds=0.1,
            seed=2,
        )
    )
    stage.add(
        quad(260, 260).moved(0, 40, 0),
        plastic(tex.bricks(1024, 18, 18, (0.36, 0.32, 0.28), (0.1, 0.09, 0.08), 6, 0.07), 0.22, repeat=1 / 60),
    )
    stage.add(
        quad(56, 56).turned("z", 45).moved(0, 32, 0.05),
        diffuse(
            tex.ornament(1024, 6, [(0.6, 0.55, 0.46), (0.4, 0.12, 0.08), (0.1, 0.16, 0.2), (0.5, 0.36, 0.14)], 3),
            repeat=1 / 28,
        ),
    )

    # Three sides: an arcade below, shuttered windows above, a tiled eave.
    brick = diffuse(tex.bricks(1024, 24, 12, (0.5, 0.22, 0.14), (0.5, 0.46, 0.4), 11), repeat=1 / 28)
    ochre = diffuse(np.asarray((0.66, 0.42, 0.2)) * (0.55 + 0.75 * tex.noise(512, 1.1, 8))[..., None], repeat=1 / 60)
    shade = diffuse((0.45, 0.4, 0.34))
    shutter = diffuse(tex.stripes(256, [(0.05, 0.22, 0.2), (0.02, 0.1, 0.09)], 8), repeat=1 / 5, turned=True)
    tiles = diffuse(tex.bricks(512, 12, 12, (0.5, 0.18, 0.09), (0.08, 0.04, 0.03), 7, 0.16), repeat=1 / 14)
    stone = diffuse(tex.marble(512, 4, (0.6, 0.57, 0.5), (0.35, 0.33, 0.3)), repeat=1 / 20)
    lit, panes, shutters, sills = [], [], [], []
    for turn, x, y in ((0, 0, 92), (90, -78, 30), (-90, 78, 30)):
        put = lambda m: m.turned("z", turn).moved(x, y, 0)
        stage.add(put(arch_wall(160, 36, 6, 8, 17, 7.2)), brick)
        stage.add(put(quad(170, 34).turned("x", 90).moved(0, 26, 17)), shade)
        stage.add(put(quad(170, 30).turned("x", 180).moved(0, 13, 35)), shade)
        stage.add(put(quad(165, 44).turned("x", 90).moved(0, 0, 58)), ochre)
        stage.add(put(box(164, 2.5, 2).moved(0, -0.5, 35.5)), stone)
        stage.add(put(quad(170, 16).turned("x", 25).moved(0, -1, 80)), tiles)
        for i in range(8):
            for z in (42, 60):
                c = -70 + i * 20
                (lit if rng.uniform() < 0.3 else panes).append(put(quad(6, 10).turned("x", 90).moved(c, -0.15, z + 5)))
                sills.append(put(box(8, 1.2, 0.6).moved(c, -0.6, z - 0.6)))
                for s in (-1, 1):
                    swing = rng.uniform(5, 50)
                    door = (
                        box(3, 0.25, 10).moved(1.5, 0, 0).turned("z", -swing)
                        if s > 0
                        else box(3, 0.25, 10).moved(-1.5, 0, 0).turned("z", swing)
                    )
                    shutters.append(put(door.moved(c + 3.1 * s, -0.3, z)))
        stage.add(
            put(
                scattered(
                    lathe([(2.4, 0), (2.4, 1), (1.7, 1.5), (1.5, 14), (1.6, 15), (2.6, 17)], 20).moved(0, -1.5, 0),
                    [(-80 + 20 * i, 0, 0) for i in range(9)],
                )
            ),
            stone,
        )
    stage.add(merged(shutters), shutter)
    stage.add(merged(sills), stone)
    stage.add(merged(panes), plastic((0.02, 0.03, 0.04)))
    stage.add(merged(lit), diffuse(0.0), glow=(1.6, 0.95, 0.4))

    # Strings of bulbs from eave to eave, and lanterns on the piers.
    wires, bulbs = [], []
    for a, b, sag in (
        ((-76, 4, 46), (76, 20, 48), 12),
        ((-76, 30, 50), (76, 12, 44), 13),
        ((-76, 52, 46), (76, 60, 48), 11),
        ((-40, 90, 46), (50, -10, 52), 14),
        ((44, 90, 48), (-60, -10, 50), 13),
    ):
        t = np.linspace(0, 1, 30)
        line = np.outer(1 - t, a) + np.outer(t, b)
        line[:, 2] -= 4 * sag * t * (1 - t)
        wires.append(tube(line, 0.1, 5))
        bulbs.append(line[1:-1] - (0, 0, 1.2))
    bulbs = np.concatenate(bulbs)
    stage.add(merged(wires), diffuse((0.02, 0.02, 0.02)))
    stage.add(scattered(cylinder(0.22, 0.7, 8), bulbs + (0, 0, 0.6)), metal("Au", 0.3))
    stage.add(scattered(sphere(0.8, 12), bulbs), diffuse(0.0), glow=(15, 9.6, 4.2))
    iron = metal("Cr", 0.3, tint=(0.35, 0.33, 0.3))
    lanterns = (
        [(-60 + 20 * i, 89.0, 24) for i in range(7)]
        + [(-75.0, 0 + 20 * i, 24) for i in range(5)]
        + [(75.0, 0 + 20 * i, 24) for i in range(5)]
    )
    stage.add(
        scattered(
            merged(
                [bar((x, y, 0), (x, y, 3), 0.15) for x in (-0.8, 0.8) for y in (-0.8, 0.8)]
                + [box(2.2, 2.2, 0.3).moved(z=3), box(2, 2, 0.2)]
            ),
            lanterns,
        ),
        iron,
    )
    stage.add(scattered(sphere(0.6, 12), np.add(lanterns, (0, 0, 1.4))), diffuse(0.0), glow=(17, 12.5, 7.5))

    # Tables with cloths, cups, bottles and candles; chairs; parasols.
    cloths = [
        diffuse(tex.checker(256, 8, (0.75, 0.72, 0.66), c) * tex.weave(256, 64, (1, 1, 1), (0.8, 0.8, 0.8)))
        for c in ((0.55, 0.06, 0.05), (0.06, 0.16, 0.4), (0.1, 0.3, 0.12))
    ]
    wood = plastic(tex.wood(256, 3, (0.35, 0.18, 0.08), (0.14, 0.06, 0.03)), 0.2, repeat=1 / 3)
    seats, tops, drinks, plates, flames, crystal, iron_legs = [], [[], [], []], [[], []], [], [], [], []
    for i, (x, y) in enumerate(
        ((-30, 2), (-8, -6), (16, 0), (38, 6), (-42, 26), (44, 34), (-26, 50), (28, 56), (2, 66), (-52, 62), (54, 66))
    ):
        x, y = x + rng.uniform(-2, 2), y + rng.uniform(-2, 2)

        def drape(u, v):
            r = 6.2 * v
            hang = np.maximum(r - 4.6, 0)
            flute = 0.25 * hang * np.sin(9 * 2 * np.pi * u)
            rr = np.minimum(r, 4.6) + 0.25 * hang + flute
            return np.stack([rr * np.cos(2 * np.pi * u), rr * np.sin(2 * np.pi * u), 7.4 - 1.5 * hang], 1)

        top = surface(drape, 72, 16)
        top.uv = top.v[:, :2] / 8
        tops[i % 3].append(top.moved(x, y, 0))
        iron_legs.append(lathe([(2.6, 0), (2.4, 0.3), (0.4, 1), (0.4, 7.2)], 16).moved(x, y, 0))
        first = rng.uniform(0, 360)
        for k in range(int(rng.integers(2, 5))):
            a = np.radians(first + 90 * k)
            seats.append(
                chair()
                .turned("z", first + 90 * k - 90 + rng.uniform(-20, 20))
                .moved(x + 6.8 * np.cos(a), y + 6.8 * np.sin(a), 0)
            )
        for _ in range(5):
            px, py = x + rng.uniform(-3, 3), y + rng.uniform(-3, 3)
            kind = rng.integers(3)
            if kind == 0:
                plates.append(
                    lathe([(0, 0.05), (0.7, 0.05), (1.2, 0.25), (1.2, 0.2), (0.7, 0), (0, 0)], 24).moved(px, py, 7.45)
                )
            elif kind == 1:
                drinks[int(rng.integers(2))].append(
                    lathe([(0, 0), (0.42, 0), (0.42, 1.7), (0.15, 2.3), (0.14, 3), (0, 3)], 16).moved(px, py, 7.42)
                )
            else:
                crystal.append(
                    lathe(
                        [
                            (0, 0.02),
                            (0.42, 0.02),
                            (0.05, 0.15),
                            (0.05, 0.9),
                            (0.42, 1.2),
                            (0.4, 1.9),
                            (0.36, 1.9),
                            (0.36, 1.25),
                            (0, 1.0),
                        ],
                        16,
                    ).moved(px, py, 7.42)
                )
        plates.append(cylinder(0.3, 1.4, 12).moved(x, y, 7.4))
        flames.append(lathe([(0, 0), (0.16, 0.2), (0.1, 0.5), (0, 0.8)], 8).moved(x, y, 8.95))
    stage.add(merged(seats), wood)
    for group, cloth in zip(tops, cloths):
        stage.add(merged(group), cloth)
    stage.add(merged(iron_legs), iron)
    stage.add(merged(plates), plastic((0.7, 0.68, 0.62)))
    stage.add(merged(drinks[0]), plastic((0.03, 0.14, 0.05)))
    stage.add(merged(drinks[1]), plastic((0.35, 0.12, 0.02)))
    stage.add(merged(crystal), glass())
    stage.add(merged(flames), diffuse(0.0), glow=(30, 17, 5))

    # Pots with shrubs, ivy on the back wall, washing on lines, crates, pigeons' worth of clutter.
    foliage, pots, flowers = [], [], []
    for i in range(26):
        x, y = (-68, -10 + 8 * i) if i < 9 else (68, -10 + 8 * (i - 9)) if i < 18 else (-56 + 16 * (i - 18), 82)
        s = rng.uniform(0.8, 1.5)
        pots.append(
            lathe([(0, 0), (1.7, 0), (2.5, 3.6), (2.8, 3.6), (2.8, 4.2), (2.3, 4.2), (2.2, 3.6), (0, 3.6)], 24)
            .scaled(s)
            .moved(x, y, 0)
        )
        for _ in range(70):
            p = rng.normal(0, 1, 3) * (1.6, 1.6, 2.0) * s + (x, y, 8 * s)
            foliage.append(
                leaf(1.7, 0.8, 0.4, 3).turned("y", rng.uniform(-80, 30)).turned("z", rng.uniform(0, 360)).moved(*p)
            )
        for _ in range(9):
            flowers.append(sphere(0.4, 8).moved(*(rng.normal(0, 1, 3) * (1.8, 1.8, 2.0) * s + (x, y, 8.4 * s))))
    for _ in range(2600):
        x = rng.normal(-8, 26)
        foliage.append(
            leaf(1.8, 1.4, 0.3, 2)
            .turned("y", rng.uniform(20, 80))
            .turned("z", rng.uniform(-140, -40))
            .moved(
                x,
                91.4 - rng.uniform(0, 0.8),
                30 + 42 * rng.uniform() ** 1.4 * np.exp(-(((x + 8) / 34) ** 2) * (1.2 + np.sin(0.5 * x))),
            )
        )
    stage.add(merged(foliage), plastic((0.06, 0.18, 0.04), 0.3))
    stage.add(merged(flowers), diffuse((0.7, 0.1, 0.2)))
    stage.add(merged(pots), diffuse((0.48, 0.2, 0.11)))
    for i in range(12):
        cloth = surface(
            lambda u, v: np.stack(
                [(u - 0.5) * 7, 0.5 * np.sin(9 * u + i) * (1 - v), (v - 1) * 9 - 0.3 * np.sin(3.1 * u)], 1
            ),
            20,
            12,
        )
        side, k = (-1, 1)[i % 2], i // 2
        stage.add(
            cloth.turned("z", 90).moved(66 * side + rng.uniform(-4, 4), -2 + 15 * k, 43),
            diffuse(
                [
                    tex.stripes(128, [(0.7, 0.68, 0.64), (0.1, 0.2, 0.4)], 4),
                    tex.dots(128, 5, (0.65, 0.6, 0.5), (0.5, 0.1, 0.08)),
                    tex.poster(256, i, [(0.7, 0.7, 0.65), (0.6, 0.1, 0.1), (0.1, 0.3, 0.3), (0.6, 0.5, 0.1)]),
                ][i % 3]
            ),
        )
    stage.add(
        merged([tube([(66 * s, -20, 43), (66 * s, 80, 43)], 0.08, 5) for s in (-1, 1)]), diffuse((0.3, 0.28, 0.24))
    )
    crates = [
        rounded_box(5, 4, 3.4, 0.15)
        .turned("z", rng.uniform(0, 90))
        .moved(rng.uniform(-64, -50), rng.uniform(-16, 20), 3.5 * (i % 2))
        for i in range(8)
    ]
    stage.add(merged(crates), diffuse(tex.planks(256, 4, 5), repeat=1 / 4))
    # A bicycle against the fountain, and the fountain.
    stage.add(lathe([(10, 0), (10, 3.4), (8.8, 3.4), (8.8, 1), (0, 1)], 8).moved(0, 32, 0), stone)
    stage.add(
        surface(
            lambda u, v: np.stack(
                [
                    8.8 * v * np.cos(6.2832 * u),
                    8.8 * v * np.sin(6.2832 * u),
                    2.6 + 0.08 * np.sin(20 * v + 2 * np.sin(18.85 * u)),
                ],
                1,
            ),
            48,
            32,
        ).moved(0, 32, 0),
        plastic((0.01, 0.05, 0.05)),
    )
    stage.add(
        lathe(
            [(2, 1), (1.2, 4), (1, 9), (4.6, 10.5), (4.8, 11), (0.8, 10.8), (0.6, 15), (1.4, 16), (0, 17.5)], 24
        ).moved(0, 32, 0),
        stone,
    )
    wheel = [ring(3.3, 0.17, 40, 8).turned("x", 90)] + [
        tube([(0, 0, 0), (3.3 * np.cos(a), 0, 3.3 * np.sin(a))], 0.03, 4) for a in np.linspace(0, 6.28, 21)[:-1]
    ]
    bike = [m.moved(dx, 0, 3.4) for dx in (-5, 5) for m in wheel]
    bike += [
        tube(p, 0.2, 8)
        for p in (
            [(-5, 0, 3.4), (-2, 0, 8.2), (3.6, 0, 8.6), (5, 0, 3.4)],
            [(-2, 0, 8.2), (-0.8, 0, 3), (3.6, 0, 8.0)],
            [(-5, 0, 3.4), (-0.8, 0, 3)],
            [(3.6, -2, 10), (3.4, 0, 10.2), (3.6, 2, 10)],
            [(3.6, 0, 8.4), (3.4, 0, 10.2)],
        )
    ]
    stage.add(merged(bike).turned("x", -12).turned("z", 18).moved(14, 15, 0), plastic((0.5, 0.06, 0.04)))
    stage.camera((-13, -52, 27), (2, 34, 12), 64)
    return stage
