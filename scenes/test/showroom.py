"""A product shot: headphones, bottles, a watch and swatches of materials on a chequered stand.

Studio environment with soft boxes, smooth and rough plastics, coated wood, glass, metals, a small visible
neon sign; units of one, 7 across.
"""

import numpy as np

import sky
import textures as tex
from mitsuba_stage import Stage, diffuse, glass, metal, plastic
from shapes import (
    Mesh,
    cylinder,
    lathe,
    quad,
    ring,
    rounded_box,
    scattered,
    sphere,
    surface,
    tube,
)

RENDERER = "mitsuba"
SIZE = (296, 222)
REFERENCE_SPP = 400
EXPOSURE = 1.0
CLAMP = 10.0
MAX_DEPTH = 14


def knot(radius, thickness, p=2, q=3):
    t = np.linspace(0, 2 * np.pi, 260)
    r = radius * (0.62 + 0.3 * np.cos(q * t))
    m = tube(np.stack([r * np.cos(p * t), r * np.sin(p * t), 0.34 * radius * np.sin(q * t)], 1), thickness, 24)
    return Mesh(m.v, m.f, m.uv / [1, 3], m.n)


def headphones(stage, place, turn):
    a = np.linspace(-0.1, np.pi + 0.1, 40)
    put = lambda m: m.turned("z", turn).moved(*place)
    band = tube(np.stack([0.82 * np.cos(a), 0 * a, 0.75 + 0.88 * np.sin(a)], 1), 0.05, 14)
    stage.add(put(band), metal("Cr", 0.1))
    pad = tube(np.stack([0.82 * np.cos(a[9:31]), 0 * a[9:31], 0.72 + 0.88 * np.sin(a[9:31])], 1), 0.085, 14)
    stage.add(put(pad), plastic((0.02, 0.02, 0.022), 0.3))
    leather = plastic(tex.mix((0.015, 0.015, 0.017), (0.04, 0.035, 0.03), tex.noise(256, 0.7, 2)), 0.25, repeat=2)
    for side in (-1, 1):
        shell = lathe([(0, 0), (0.24, 0.0), (0.37, 0.07), (0.4, 0.2), (0.36, 0.26)])
        cup = shell.turned("y", -90 * side).moved(1.02 * side, 0, 0.6)
        stage.add(put(cup), plastic((0.62, 0.1, 0.03)))
        stage.add(put(ring(0.3, 0.1).turned("y", 90).moved(0.75 * side, 0, 0.6)), leather)
        stage.add(put(ring(0.25, 0.014).turned("y", 90).moved(1.02 * side, 0, 0.6)), metal("Au", 0.06))


def build():
    rng = np.random.default_rng(9)
    stage = Stage()
    stage.environment(
        sky.studio(
            256,
            [
                (250, 48, 44, 26, (13, 12.5, 12)),
                (165, 24, 16, 60, (9, 10, 12)),
                (20, 28, 34, 22, (5, 4.3, 3.5)),
                (300, 12, 8, 8, (60, 46, 30)),
            ],
            0.16,
            seed=3,
        ),
        turn=0,
    )

    def sweep(u, v):
        bend = np.clip((v - 0.55) / 0.3, 0, 1)
        return np.stack([(u - 0.5) * 14, -4 + v * 11, 2.8 * bend**2 + 8 * np.maximum(v - 0.85, 0)], 1)

    stage.add(
        surface(sweep, 20, 60),
        plastic(
            tex.checker(512, 2, (0.55, 0.54, 0.52), (0.2, 0.21, 0.24))
            * (0.85 + 0.3 * tex.noise(512, 0.9, 4)[..., None]),
            0.12,
            repeat=9,
        ),
    )

    headphones(stage, (-1.45, 1.0, 0.42), 24)
    stage.add(cylinder(0.95, 0.3, 64).moved(-1.45, 1.0, 0), plastic(tex.wood(512, 31, rings=7), 0.06, repeat=2))
    stage.add(
        knot(1.0, 0.17).turned("x", 62).turned("z", -20).moved(1.35, 1.7, 1.05),
        metal("Cu", 0.12 + 0.25 * tex.noise(256, 1.1, 6), repeat=2),
    )
    stage.add(cylinder(0.7, 0.24, 64).moved(1.35, 1.7, 0), plastic(tex.marble(512, 14), repeat=2))

    # Bottles with labels.
    def label(seed):
        return plastic(
            tex.page(420, 300, seed, columns=1, line=30, paper=(0.8, 0.76, 0.62), ink=(0.3, 0.02, 0.03), picture=False),
            0.2,
        )

    for i, (x, y, s, body) in enumerate(
        ((0.25, 0.2, 1.0, glass()), (0.8, -0.5, 0.8, plastic((0.02, 0.1, 0.06))), (-0.2, -0.75, 0.62, glass()))
    ):
        stage.add(
            lathe([(0, 0), (0.26, 0), (0.3, 0.05), (0.3, 0.85), (0.12, 1.15), (0.1, 1.35), (0, 1.35)])
            .scaled(s)
            .moved(x, y, 0.002),
            body,
        )
        wrap = lathe([(0.304, 0.2), (0.304, 0.68)])
        wrap.uv = np.stack([wrap.uv[:, 0] * 2, 1 - wrap.uv[:, 1]], 1)
        stage.add(wrap.turned("z", 40 * i).scaled(s).moved(x, y, 0), label(700 + i))
        stage.add(
            lathe([(0.13, 1.3), (0.14, 1.32), (0.14, 1.5), (0, 1.52)], 24).scaled(s).moved(x, y, 0),
            [metal("Au", 0.18), plastic((0.55, 0.02, 0.03)), metal("Al", 0.3)][i],
        )

    # Swatches: a fan of small plates, each another material.
    finishes = [
        metal("Al", 0.05 + 0.3 * tex.noise(256, 0.9, 3, (1, 30)), repeat=3),
        plastic(tex.weave(256, 10, (0.06, 0.06, 0.07), (0.015, 0.015, 0.015)), repeat=3),
        plastic(tex.terrazzo(512, 9), 0.1, repeat=1.5),
        metal("Au", 0.3),
        diffuse(tex.weave(256, 16, (0.6, 0.5, 0.3), (0.2, 0.35, 0.4)), repeat=2),
        plastic((0.03, 0.16, 0.4)),
        metal("Cr", 0.04),
        plastic(tex.planks(256, 5, 8), 0.15, repeat=2),
        diffuse(tex.dots(256, 8, (0.75, 0.7, 0.6), (0.1, 0.3, 0.25)), repeat=2),
    ]
    for i, finish in enumerate(finishes):
        plate = rounded_box(0.36, 0.9, 0.05, 0.02).moved(0, 0.7, 0.03 + 0.012 * i).turned("z", 52 - 13 * i)
        stage.add(plate.moved(1.75, -1.35, 0), finish)
    # A watch, beads, screws, a coiled cable, a folded leaflet.
    stage.add(
        lathe([(0, 0), (0.3, 0), (0.34, 0.04), (0.34, 0.12), (0.3, 0.14)]).moved(-0.75, -1.1, 0.06), metal("Cr", 0.12)
    )
    dial = tex.stripes(256, [(0.75, 0.74, 0.7)], 1)
    yy, xx = tex.lattice(256)
    spokes = (np.abs(((np.arctan2(yy - 0.5, xx - 0.5) / np.pi * 6) + 0.5) % 1 - 0.5) < 0.08) & (
        np.hypot(yy - 0.5, xx - 0.5) > 0.33
    )
    dial[spokes | (np.hypot(yy - 0.5, xx - 0.5) < 0.05)] = 0.02
    face = quad(0.6, 0.6)
    face.uv = face.uv / 0.6
    stage.add(face.turned("z", 15).moved(-0.75, -1.1, 0.18), diffuse(dial))
    strap = surface(
        lambda u, v: np.stack([(u - 0.5) * 0.34, (v - 0.5) * 2.4, 0.03 + 0.1 * np.sin(np.pi * v)], 1), 8, 60
    )
    stage.add(
        strap.turned("z", -35).moved(-0.75, -1.1, 0),
        plastic(tex.weave(256, 12, (0.25, 0.1, 0.04), (0.15, 0.05, 0.02)), 0.2, repeat=4),
    )
    a = np.linspace(0, 2 * np.pi * 5, 400)
    stage.add(
        tube(
            np.stack(
                [
                    -2.1 + (0.5 + 0.012 * a) * np.cos(a),
                    -0.75 + (0.5 + 0.012 * a) * np.sin(a),
                    0.06 + 0.05 * (1 + np.sin(a * 1.7)),
                ],
                1,
            ),
            0.035,
            10,
        ),
        plastic((0.55, 0.53, 0.5), 0.15),
    )
    stage.add(
        scattered(
            sphere(0.09, 24), np.stack([rng.uniform(-2.6, 2.4, 26), rng.uniform(-1.9, -0.2, 26), np.full(26, 0.092)], 1)
        ),
        metal("Ag", 0.03),
    )
    stage.add(
        scattered(
            sphere(0.07, 20), np.stack([rng.uniform(-2.6, 2.4, 26), rng.uniform(-1.9, 0.4, 26), np.full(26, 0.072)], 1)
        ),
        glass(),
    )
    leaflet = surface(
        lambda u, v: np.stack([(u - 0.5) * 1.0, (v - 0.5) * 1.3, 0.02 + 0.28 * np.abs(u - 0.5) ** 0.8], 1), 24, 4
    )
    leaflet.uv[:, 1] = 1 - leaflet.uv[:, 1]
    stage.add(leaflet.turned("z", -24).moved(2.55, 0.1, 0), diffuse(tex.page(500, 650, 720, line=22)))
    # Visible lights: a neon squiggle and three diodes.
    t = np.linspace(0, 1, 120)
    stage.add(
        tube(np.stack([-0.6 + 2.0 * t, 3.1 + 0 * t, 1.9 + 0.28 * np.sin(15 * t) * (1 - 0.4 * t)], 1), 0.022, 8),
        diffuse(0.0),
        glow=(17, 3.0, 6.5),
    )
    stage.add(
        scattered(sphere(0.035, 12), [(-2.3 + 0.2 * i, 1.9, 0.66) for i in range(3)]), diffuse(0.0), glow=(2, 12, 5)
    )
    stage.add(rounded_box(0.9, 0.5, 0.66, 0.05).moved(-2.1, 2.2, 0), plastic((0.04, 0.045, 0.05), 0.15))
    stage.camera((0.15, -5.6, 2.9), (0.05, 0.4, 0.55), 44)
    return stage
