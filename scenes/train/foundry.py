"""Machine parts of brushed, cast and polished metal in a workshop whose painted signs mirror in them.

Glossy and rough conductors, textured roughness, reflections that carry patterns; millimetres, about 900 across.
"""

import numpy as np

import textures as tex
from mitsuba_stage import Stage, diffuse, metal, plastic
from shapes import (
    bar,
    cylinder,
    lathe,
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
REFERENCE_SPP = 1024
EXPOSURE = 1.0
CLAMP = 10.0
MAX_DEPTH = 12

SIGNS = [(0.75, 0.7, 0.6), (0.02, 0.02, 0.03), (0.7, 0.08, 0.03), (0.75, 0.45, 0.02), (0.03, 0.2, 0.45)]


def gear(outer, teeth, thickness):
    """A spur gear with a bored hub: the lattice of a turned profile whose radius follows the teeth."""

    def rim(u, v):
        t = u * 2 * np.pi
        r = outer * (1 + 0.09 * np.clip(1.6 * np.cos(teeth * t), -1, 1))
        return np.stack([r * np.cos(t), r * np.sin(t), (v - 0.5) * thickness], 1)

    def face(side):
        def f(u, v):
            t = u * 2 * np.pi
            r = outer * (1 + 0.09 * np.clip(1.6 * np.cos(teeth * t), -1, 1)) * v + 0.2 * outer * (1 - v)
            dish = -0.22 * thickness * (np.abs(v - 0.55) < 0.25)
            return np.stack([r * np.cos(t), -side * r * np.sin(t) * -1, side * (thickness / 2 + dish)], 1)

        return f

    parts = [surface(rim, teeth * 12, 2), surface(face(1), teeth * 12, 24), surface(face(-1), teeth * 12, 24)]
    parts.append(cylinder(0.32 * outer, thickness * 1.3).moved(z=-0.65 * thickness))
    return merged(parts)


def spring(radius, height, turns, wire):
    t = np.linspace(0, 1, turns * 36)
    a = 2 * np.pi * turns * t
    return tube(np.stack([radius * np.cos(a), radius * np.sin(a), height * t + wire], 1), wire)


def bolt(radius, length):
    head = lathe([(0, 0), (1.9 * radius, 0), (1.9 * radius, 1.2 * radius), (0, 1.5 * radius)], 6)
    head.n = None
    ridges = [(radius * (1 if i % 2 else 0.86), 1.2 * radius + length * i / 40) for i in range(41)]
    thread = lathe(ridges + [(0, 1.2 * radius + length)], 20)
    thread.n = None
    return merged([head, thread])


def build():
    rng = np.random.default_rng(4)
    stage = Stage()
    scratches = tex.noise(1024, 0.9, 2, (1, 40))
    brushed = metal(
        "Al", 0.06 + 0.3 * scratches**2, repeat=1 / 400, tint=0.55 + 0.45 * scratches[..., None] * [1, 1, 1]
    )
    cast = metal("Cr", 0.32)
    polished = metal("Cr", 0.03)
    copper = metal("Cu", 0.14)
    brass = metal("Au", 0.22)
    worn = tex.noise(512, 1.3, 8)
    blued = metal("Cr", 0.08 + 0.3 * worn, tint=tex.ramp(worn, [(0.25, 0.35, 0.7), (0.6, 0.35, 0.6), (0.8, 0.6, 0.25)]))

    # The bench: a brushed plate on oily wood, before a wall of painted signs.
    stage.add(quad(1600, 1200), plastic(tex.planks(1024, 7, 30), 0.2, repeat=1 / 700))
    stage.add(rounded_box(640, 470, 10, 4).moved(0, 30, 0), brushed)
    wall = quad(1600, 900).turned("x", 90).moved(0, 330, 450)
    stage.add(wall, diffuse(tex.bricks(1024, 12, 6, (0.4, 0.16, 0.1), (0.5, 0.47, 0.42), 2), repeat=1 / 600))
    for i, (x, z, side) in enumerate(((-330, 190, 210), (-95, 240, 240), (150, 180, 200), (365, 250, 220))):
        sign = quad(side, side)
        sign.uv = sign.uv / side
        stage.add(sign.turned("x", 90).moved(x, 322, z), plastic(tex.poster(512, 80 + i, SIGNS), 0.1))
    stripes = quad(1600, 70).turned("x", 90).moved(0, 326, 40)
    stage.add(stripes.textured(1 / 80), diffuse(tex.stripes(256, [(0.75, 0.5, 0.02), (0.02, 0.02, 0.02)], 1)))
    # What only the metal sees: a chequered door and shelves behind the camera.
    stage.add(
        quad(1800, 1000).turned("x", -90).moved(0, -900, 500),
        diffuse(tex.checker(512, 6, (0.7, 0.68, 0.6), (0.1, 0.2, 0.16)), repeat=1 / 900),
    )
    for side in (-1, 1):
        shelf = quad(1300, 900).turned("x", 90).turned("z", -90 * side).moved(700 * side, -250, 450)
        stage.add(shelf, diffuse(tex.spines(1024, 512, 24, 5 + side, SIGNS[1:]), repeat=1 / 900))
    stage.add(quad(1600, 1300).turned("x", 180).moved(0, -250, 950), diffuse((0.5, 0.5, 0.48)))

    stage.add(gear(95, 22, 34).turned("z", 8).moved(-150, 60, 30), cast)
    stage.add(gear(62, 14, 30).moved(20, 105, 27), blued)
    stage.add(gear(120, 30, 30).turned("x", 78).turned("z", -18).moved(-240, 205, 140), brushed)
    stage.add(
        lathe(
            [(0, 0), (80, 0), (84, 10), (60, 26), (30, 60), (26, 120), (44, 160), (66, 176), (66, 184), (0, 190)]
        ).moved(180, 150, 10),
        blued,
    )
    stage.add(
        lathe([(38, 0), (70, 0), (74, 6), (74, 40), (70, 46), (38, 46), (34, 40), (34, 6), (38, 0)]).moved(
            140, -60, 10
        ),
        brass,
    )
    stage.add(
        scattered(
            sphere(11, 24), [(140 + 54 * np.cos(t), -60 + 54 * np.sin(t), 60) for t in np.linspace(0, 6.28, 13)[:-1]]
        ),
        polished,
    )
    stage.add(sphere(46).moved(270, 30, 56), polished)
    stage.add(spring(34, 130, 9, 6).moved(-20, -30, 10), copper)
    stage.add(spring(20, 190, 16, 3.5).turned("y", 90).turned("z", 25).moved(-270, -90, 32), polished)
    for i in range(16):
        b = bolt(rng.uniform(6, 11), rng.uniform(40, 75)).turned("y", 90).turned("z", rng.uniform(0, 360))
        stage.add(b.moved(rng.uniform(-300, 300), rng.uniform(-210, -90), 30), [cast, brass, copper, brushed][i % 4])
    stage.add(
        merged(
            [ring(rng.uniform(14, 26), 4).moved(rng.uniform(-310, 310), rng.uniform(-215, -20), 14) for _ in range(22)]
        ),
        copper,
    )
    stage.add(tube([(330, 260, 0), (330, 260, 260), (300, 240, 330), (220, 200, 350), (0, 190, 360)], 16, 20), brass)
    stage.add(merged([bar((x, 316, 0), (x, 316, 520), 14) for x in (-455, -215, 30, 262)]), cast)

    # Two strip lights overhead, one of them seen in the metal only from afar.
    stage.add(quad(700, 60).turned("x", 180).moved(-100, 0, 900), diffuse(0.0), glow=(55, 50, 42))
    stage.add(quad(60, 500).turned("x", 180).moved(420, -500, 880), diffuse(0.0), glow=(22, 30, 44))
    stage.camera((40, -560, 330), (-5, 60, 70), 50)
    return stage
