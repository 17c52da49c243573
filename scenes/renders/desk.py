"""The one small scene that every file of tests/renders shows, described for either renderer.

A tiled desk, and half a brick wall behind it: beside the wall there is nothing, so that a transparent film has
something to be transparent about. On the desk are a glass ball, a knot of rough metal, a wooden box and a dotted
plastic ball. A lamp above the picture lights them, and a small glowing ball stands in it.
"""

import shapes
import textures

SIZE = (72, 48)
EYE, TARGET, FOV = (0.5, -5.6, 2.1), (0.1, 0.2, 0.75), 36.0
# What a lens is focused on: the front of the box.
FOCUS = (-1.1, 0.0, 0.6)
LAMP = {"origin": (-2.2, -2.0, 4.2), "target": (0.0, 0.3, 0.4), "width": 0.9, "colour": (1.0, 0.86, 0.7)}
GLOW = {"centre": (0.55, -1.0, 0.2), "radius": 0.2, "colour": (0.35, 0.65, 1.0), "radiance": 6.0}


def things(kit, metal):
    """(name, mesh, material) of all that does not shine; `kit` is a stage module, `metal` what the knot is made of."""
    tiles = textures.ornament(128, 3, [(0.75, 0.7, 0.6), (0.12, 0.25, 0.42), (0.55, 0.2, 0.12), (0.3, 0.35, 0.2)], 3)
    bricks = textures.bricks(128, 8, 4, (0.5, 0.2, 0.13), (0.6, 0.57, 0.52), 5)
    dots = textures.dots(128, 7, (0.85, 0.8, 0.2), (0.1, 0.42, 0.2))
    yield "Desk", shapes.quad(5.2, 4.4).moved(y=0.2), kit.diffuse(tiles, repeat=0.5)
    yield "Wall", shapes.quad(3.2, 2.6).turned("x", 90).moved(-1.0, 2.0, 1.3), kit.diffuse(bricks, repeat=0.6)
    box = shapes.rounded_box(0.9, 0.9, 1.1, 0.06).turned("z", 25).moved(-1.1, 0.5)
    yield "Box", box, kit.diffuse(textures.wood(128, 7))
    yield "Glass", shapes.sphere(0.52).moved(0.1, 0.1, 0.52), kit.glass()
    knot = shapes.knot(2, 3, 0.13).scaled(0.62).turned("x", 70).moved(1.25, 0.7, 0.72)
    yield "Knot", knot, metal
    yield "Ball", shapes.sphere(0.36).moved(-0.75, -0.75, 0.36), kit.plastic(dots)


def glow():
    return shapes.sphere(GLOW["radius"]).moved(*GLOW["centre"])
