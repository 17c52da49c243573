"""A study lit through one window behind a curtain: most of the light has bounced several times.

Strong indirect light, wood, cloth, books, a patterned rug; metres.
"""

import numpy as np

import textures as tex
from mitsuba_stage import Stage, diffuse, glass, metal, plastic
from shapes import (
    bar,
    box,
    curtain,
    cylinder,
    lathe,
    merged,
    quad,
    rounded_box,
    scattered,
    sphere,
    tube,
)

RENDERER = "mitsuba"
SIZE = (256, 256)
REFERENCE_SPP = 448
EXPOSURE = 1.3
CLAMP = 5.0
MAX_DEPTH = 14

PAPER = [
    (0.45, 0.07, 0.05),
    (0.06, 0.13, 0.3),
    (0.5, 0.36, 0.13),
    (0.08, 0.2, 0.1),
    (0.55, 0.5, 0.42),
    (0.12, 0.05, 0.08),
]


def shell(stage):
    """Floor, ceiling and walls (5 x 6 x 2.8 m) with a window opening in the left wall."""
    stage.add(quad(5, 6), plastic(tex.planks(1024, 8, 3), 0.15, repeat=0.5))
    stage.add(quad(5, 6).turned("x", 180).moved(z=2.8), diffuse((0.8, 0.79, 0.75)))
    wall = diffuse(
        np.clip(
            tex.mix(
                (0.42, 0.45, 0.36),
                (0.62, 0.6, 0.48),
                tex.smoothstep(
                    0.45, 0.55, tex.ornament(512, 4, [(0, 0, 0), (1, 1, 1), (0, 0, 0), (1, 1, 1)], 5)[..., 0]
                ),
            ),
            0,
            1,
        ),
        repeat=0.7,
    )
    stage.add(quad(5, 2.8).turned("x", 90).moved(0, 3, 1.4), wall)
    stage.add(quad(6, 2.8).turned("x", 90).turned("z", -90).moved(2.5, 0, 1.4), wall)
    plain = diffuse((0.66, 0.62, 0.52))
    stage.add(quad(5, 2.8).turned("x", 90).turned("z", 180).moved(0, -3, 1.4), plain)
    for depth, height, y, z in (
        (1.9, 2.8, -2.05, 1.4),
        (2.5, 2.8, 1.75, 1.4),
        (1.6, 0.8, -0.3, 0.4),
        (1.6, 0.5, -0.3, 2.55),
    ):
        stage.add(quad(depth, height).turned("x", 90).turned("z", 90).moved(-2.5, y, z), plain)
    skirting = plastic((0.7, 0.68, 0.62), 0.1)
    stage.add(box(5, 0.03, 0.12).moved(0, 2.98, 0), skirting)
    stage.add(box(0.03, 6, 0.12).moved(2.48, 0, 0), skirting)


def window(stage):
    """Bars in the opening, a curtain half drawn, and a bright haze outside as the only lamp."""
    white = diffuse((0.75, 0.74, 0.7))
    frame = [box(0.08, 0.05, 1.5).moved(-2.5, y, 0.8) for y in (-1.08, -0.56, -0.04, 0.48)]
    frame += [box(0.08, 1.6, 0.05).moved(-2.5, -0.3, z) for z in (0.8, 1.3, 1.8, 2.28)]
    stage.add(merged(frame), white)
    cloth = diffuse(tex.weave(256, 24, (0.5, 0.12, 0.08), (0.6, 0.3, 0.16)), repeat=3)
    stage.add(curtain(0.9, 2.3, 6, 0.06, np.random.default_rng(1)).turned("z", 90).moved(-2.4, 0.55, 0.2), cloth)
    stage.add(quad(1.7, 1.6).turned("x", 90).turned("z", 90).moved(-2.8, -0.3, 1.55), white, glow=(52, 58, 66))


def shelves(stage, rng):
    """A bookcase along the right wall, books cut from images of spines, and vases between them."""
    wood = plastic(tex.wood(512, 11, (0.3, 0.15, 0.07), (0.12, 0.05, 0.02)), 0.12, repeat=1.2)
    boards = [box(0.32, 2.6, 0.03).moved(2.33, 1.3, z) for z in (0.1, 0.52, 0.94, 1.36, 1.78, 2.2)]
    boards += [box(0.32, 0.03, 2.13).moved(2.33, y, 0.1) for y in (0.0, 0.86, 1.73, 2.6)]
    stage.add(merged(boards), wood)
    vase = lathe([(0.0, 0), (0.06, 0), (0.1, 0.08), (0.11, 0.15), (0.05, 0.24), (0.06, 0.3)])
    for row, z in enumerate((0.13, 0.55, 0.97, 1.39, 1.81)):
        for column in range(3):
            y = 0.04 + column * 0.87
            if rng.uniform() < 0.25:
                stage.add(
                    vase.moved(2.3, y + rng.uniform(0.25, 0.6), z),
                    [metal("Au", 0.18), plastic((0.05, 0.2, 0.3)), plastic((0.6, 0.55, 0.4), 0.05)][rng.integers(3)],
                )
                continue
            cover = diffuse(tex.spines(768, 320, 17, row * 3 + column, PAPER))
            used = rng.uniform(0.55, 0.8)
            tall = rng.uniform(0.24, 0.33)
            books = box(0.2, used, tall)
            books.uv = np.stack([books.v[:, 1] / used + 0.5, 1 - books.v[:, 2] / tall], 1)
            stage.add(books.moved(2.33, y + used / 2, z), cover)


def desk(stage, rng):
    """A desk with papers, a mug, a globe and a bent lamp that is switched off."""
    wood = plastic(tex.wood(512, 21, (0.5, 0.26, 0.1), (0.2, 0.08, 0.03), 6), 0.08, repeat=0.8)
    stage.add(box(1.7, 0.8, 0.05).moved(-0.5, 1.6, 0.72), wood)
    stage.add(merged([box(0.07, 0.07, 0.72).moved(x, y, 0) for x in (-1.28, 0.28) for y in (1.26, 1.94)]), wood)
    for i in range(7):
        sheet = quad(0.21, 0.3)
        sheet.uv = sheet.uv / [0.21, 0.3]
        sheet.uv[:, 1] = 1 - sheet.uv[:, 1]
        stage.add(
            sheet.turned("z", rng.uniform(-60, 60)).moved(
                rng.uniform(-1.1, 0.1), rng.uniform(1.35, 1.85), 0.773 + i * 0.002
            ),
            diffuse(tex.page(320, 450, 40 + i, line=16)),
        )
    mug = lathe([(0, 0), (0.04, 0), (0.04, 0.1), (0.036, 0.1), (0.036, 0.01), (0, 0.01)])
    stage.add(mug.moved(0.1, 1.4, 0.77), plastic((0.5, 0.06, 0.04)))
    stage.add(
        sphere(0.16).moved(-1.05, 1.75, 1.02),
        plastic(
            tex.ramp(tex.noise(512, 1.8, 5), [(0.03, 0.1, 0.3), (0.06, 0.2, 0.4), (0.3, 0.28, 0.1), (0.1, 0.25, 0.06)])
        ),
    )
    brass = metal("Au", 0.12)
    stage.add(lathe([(0, 0), (0.1, 0), (0.1, 0.02), (0.02, 0.05), (0.015, 0.1)]).moved(-1.05, 1.75, 0.77), brass)
    arm = np.array([(0.2, 1.8, 0.79), (0.25, 1.8, 1.1), (0.15, 1.75, 1.35), (-0.05, 1.65, 1.4), (-0.15, 1.6, 1.32)])
    stage.add(tube(arm, 0.012), brass)
    stage.add(lathe([(0.1, 0), (0.04, 0.12), (0.02, 0.14)]).moved(-0.15, 1.6, 1.2), brass)


def chairs(stage):
    """A leather armchair and a spindle-backed chair."""
    leather = plastic(tex.mix((0.2, 0.07, 0.03), (0.3, 0.12, 0.05), tex.noise(256, 0.8, 9)), 0.2, repeat=4)
    chair = [
        rounded_box(0.75, 0.75, 0.25, 0.08).moved(0, 0, 0.2),
        rounded_box(0.75, 0.2, 0.75, 0.09).moved(0, 0.36, 0.2),
        rounded_box(0.18, 0.75, 0.45, 0.08).moved(-0.4, 0, 0.2),
        rounded_box(0.18, 0.75, 0.45, 0.08).moved(0.4, 0, 0.2),
    ]
    stage.add(merged(chair).turned("z", 60).moved(-1.3, 0.35, 0), leather)
    cushion = rounded_box(0.42, 0.14, 0.4, 0.07)
    stage.add(
        cushion.turned("x", -15).turned("z", 60).moved(-1.42, 0.42, 0.45),
        diffuse(tex.weave(256, 12, (0.75, 0.65, 0.4), (0.1, 0.25, 0.35)), repeat=4),
    )
    wood = plastic((0.12, 0.05, 0.02), 0.1)
    parts = [box(0.42, 0.42, 0.04).moved(0, 0, 0.44)]
    parts += [bar((x, y, 0), (x * 0.85, y * 0.85, 0.45), 0.035) for x in (-0.19, 0.19) for y in (-0.19, 0.19)]
    parts += [bar((x, -0.19, 0.47), (x * 1.1, -0.27, 0.95), 0.016) for x in np.linspace(-0.18, 0.18, 8)]
    parts += [bar((-0.24, -0.27, 0.95), (0.24, -0.27, 0.95), 0.05)]
    stage.add(merged(parts).turned("z", 20).moved(-0.35, 1.0, 0), wood)


def build():
    rng = np.random.default_rng(7)
    stage = Stage()
    shell(stage)
    window(stage)
    shelves(stage, rng)
    desk(stage, rng)
    chairs(stage)
    rug = quad(2.2, 1.7)
    stage.add(
        rug.moved(0.5, 0.2, 0.006),
        diffuse(
            tex.ornament(768, 5, [(0.3, 0.03, 0.03), (0.5, 0.38, 0.2), (0.04, 0.06, 0.16), (0.35, 0.14, 0.05)], 3)
            * tex.weave(768, 190, (1, 1, 1), (0.75, 0.75, 0.75)),
            repeat=0.6,
        ),
    )
    for i, (x, size) in enumerate(((-1.5, 0.62), (-0.6, 0.5), (0.35, 0.72))):
        picture = quad(size, size)
        picture.uv = picture.uv / size
        stage.add(
            picture.turned("x", 90).moved(x, 2.955, 1.75),
            plastic(
                tex.poster(
                    384,
                    60 + i,
                    [(0.7, 0.65, 0.5), (0.05, 0.05, 0.08), (0.6, 0.12, 0.05), (0.1, 0.25, 0.4), (0.7, 0.45, 0.1)],
                )
            ),
        )
        stage.add(
            merged(
                [
                    bar(
                        (x + a * size / 2, 2.95, 1.75 - size / 2 - 0.02),
                        (x + a * size / 2, 2.95, 1.75 + size / 2 + 0.02),
                        0.04,
                    )
                    for a in (-1, 1)
                ]
                + [
                    bar((x - size / 2, 2.95, 1.75 + a * size / 2), (x + size / 2, 2.95, 1.75 + a * size / 2), 0.04)
                    for a in (-1, 1)
                ]
            ),
            metal("Au", 0.25),
        )
    stage.add(sphere(0.11).moved(0.25, 0.15, 0.12), glass())
    stage.add(scattered(cylinder(0.03, 0.25, 12), [(0.9, 0.3, 0), (0.97, 0.33, 0), (0.93, 0.24, 0)]), metal("Cu", 0.1))
    # Two small wall lamps in sight; one mesh, since every further light takes samples from the window.
    spots = [(-1.05, 2.9, 1.66), (0.95, 2.9, 1.66)]
    bracket = lathe([(0, 0), (0.05, 0), (0.02, 0.03), (0.015, 0.1)], 24).turned("x", 90)
    stage.add(scattered(bracket, np.add(spots, (0, 0.09, -0.04))), metal("Au", 0.15))
    stage.add(scattered(sphere(0.045, 24), spots), diffuse(0.0), glow=(15, 11, 6.5), share=0.15)
    stage.camera((-0.7, -2.1, 1.5), (0.55, 1.6, 0.9), 64)
    return stage
