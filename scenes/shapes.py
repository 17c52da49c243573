"""Triangle meshes made with numpy; both renderers are fed from these.

Everything is Z-up. Texture coordinates of flat parts are in scene units, so that one pattern keeps its size
on parts of different sizes.
"""

from dataclasses import dataclass

import numpy as np


@dataclass
class Mesh:
    """Vertices (n,3), triangles (m,3), texture coordinates (n,2), normals (n,3) or None for flat faces."""

    v: np.ndarray
    f: np.ndarray
    uv: np.ndarray
    n: np.ndarray | None = None

    def moved(self, x=0.0, y=0.0, z=0.0):
        return Mesh(self.v + np.array([x, y, z], float), self.f, self.uv, self.n)

    def scaled(self, x, y=None, z=None):
        s = np.array([x, x if y is None else y, x if z is None else z], float)
        n = None if self.n is None else unit(self.n / s)
        return Mesh(self.v * s, self.f, self.uv, n)

    def turned(self, axis, degrees):
        r = rotation(axis, degrees)
        return Mesh(self.v @ r.T, self.f, self.uv, None if self.n is None else self.n @ r.T)

    def textured(self, u, v=None, du=0.0, dv=0.0):
        """The same mesh with scaled and shifted texture coordinates."""
        return Mesh(self.v, self.f, self.uv * [u, u if v is None else v] + [du, dv], self.n)


def unit(a):
    return a / np.maximum(np.linalg.norm(a, axis=-1, keepdims=True), 1e-12)


def rotation(axis, degrees):
    t = np.radians(degrees)
    c, s = np.cos(t), np.sin(t)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def merged(meshes):
    """One mesh out of many (all with normals, or all without)."""
    meshes = list(meshes)
    starts = np.cumsum([0] + [len(m.v) for m in meshes])
    n = None if any(m.n is None for m in meshes) else np.concatenate([m.n for m in meshes])
    return Mesh(
        np.concatenate([m.v for m in meshes]),
        np.concatenate([m.f + s for m, s in zip(meshes, starts)]),
        np.concatenate([m.uv for m in meshes]),
        n,
    )


def scattered(mesh, places, angles=None, sizes=None):
    """Copies of `mesh` at `places` (k,3), turned about Z by `angles` (degrees) and scaled by `sizes`."""
    k = len(places)
    t = np.radians(np.zeros(k) if angles is None else angles)
    s = np.ones(k) if sizes is None else np.asarray(sizes, float)
    r = np.zeros((k, 3, 3))
    r[:, 0, 0] = r[:, 1, 1] = np.cos(t)
    r[:, 1, 0] = np.sin(t)
    r[:, 0, 1] = -np.sin(t)
    r[:, 2, 2] = 1
    v = np.einsum("kij,nj->kni", r, mesh.v) * s[:, None, None] + np.asarray(places)[:, None, :]
    n = None if mesh.n is None else np.einsum("kij,nj->kni", r, mesh.n).reshape(-1, 3)
    f = (mesh.f[None] + (np.arange(k) * len(mesh.v))[:, None, None]).reshape(-1, 3)
    return Mesh(v.reshape(-1, 3), f, np.tile(mesh.uv, (k, 1)), n)


def quad(width, height):
    """A rectangle in the XY plane, facing +Z, centred."""
    x, y = width / 2, height / 2
    v = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], float)
    return Mesh(v, np.array([[0, 1, 2], [0, 2, 3]]), v[:, :2] + [x, y])


def box(width, depth, height):
    """A box standing on z = 0, centred in x and y."""
    sides = [quad(width, depth).turned("y", 180), quad(width, depth).moved(z=height)]
    for turn, a, b in ((0, width, depth), (90, depth, width), (180, width, depth), (270, depth, width)):
        sides.append(quad(a, height).turned("x", 90).moved(0, -b / 2, height / 2).turned("z", turn))
    return merged([sides[0].moved(), *sides[1:]])


def bar(start, end, width, depth=None):
    """A box-shaped beam from one point to another."""
    start, end = np.array(start, float), np.array(end, float)
    length = np.linalg.norm(end - start)
    z = unit(end - start)
    x = unit(np.cross([0, 1, 0] if abs(z[2]) > 0.9 else [0, 0, 1], z))
    frame = np.stack([x, np.cross(z, x), z], 1)
    m = box(width, depth or width, length)
    return Mesh(m.v @ frame.T + start, m.f, m.uv)


def grid(columns, rows):
    """Triangles of a (rows+1) x (columns+1) lattice of vertices, row after row."""
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (i * (columns + 1) + j).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def smoothed(mesh):
    """`mesh` with vertex normals averaged from its faces."""
    p = mesh.v[mesh.f]
    face = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    n = np.zeros_like(mesh.v)
    for corner in range(3):
        np.add.at(n, mesh.f[:, corner], face)
    return Mesh(mesh.v, mesh.f, mesh.uv, unit(n))


def surface(function, columns, rows):
    """A smooth surface: `function(u, v)` gives points (…,3) for u, v in 0..1."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    points = function(u.ravel(), v.ravel())
    return smoothed(Mesh(points, grid(columns, rows), np.stack([u.ravel(), v.ravel()], 1)))


def lathe(profile, segments=48):
    """The profile [(radius, z), …] turned about Z; corners sharper than 35 degrees stay sharp."""
    p = np.array(profile, float)
    d = unit(np.diff(p, axis=0))
    cuts = [0] + [i for i in range(1, len(p) - 1) if d[i - 1] @ d[i] < np.cos(np.radians(35))] + [len(p) - 1]
    t = np.linspace(0, 2 * np.pi, segments + 1)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    parts = []
    for a, b in zip(cuts, cuts[1:]):
        r, z = p[a : b + 1, 0], p[a : b + 1, 1]
        slope = np.gradient(p[a : b + 1], axis=0)
        nr, nz = slope[:, 1], -slope[:, 0]
        v = np.stack([np.outer(r, np.cos(t)), np.outer(r, np.sin(t)), np.outer(z, np.ones_like(t))], -1)
        n = np.stack([np.outer(nr, np.cos(t)), np.outer(nr, np.sin(t)), np.outer(nz, np.ones_like(t))], -1)
        uv = np.stack(np.broadcast_arrays(t[None] / (2 * np.pi), length[a : b + 1, None] / length[-1]), -1)
        parts.append(Mesh(v.reshape(-1, 3), grid(segments, b - a), uv.reshape(-1, 2), unit(n.reshape(-1, 3))))
    return merged(parts)


def sphere(radius=1.0, segments=48):
    t = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    return lathe(np.stack([np.maximum(np.cos(t), 0) * radius, np.sin(t) * radius], 1), segments)


def cylinder(radius, height, segments=32):
    return lathe([(0, 0), (radius, 0), (radius, height), (0, height)], segments)


def tube(path, radius, sides=8):
    """A round tube along `path` (k,3); `radius` is one number or one per point."""
    path = np.asarray(path, float)
    k = len(path)
    tangent = unit(np.gradient(path, axis=0))
    # Carry one normal along the path: a frame built anew at each point would twist.
    normal = np.zeros_like(path)
    start = np.cross(tangent[0], [0, 0, 1] if abs(tangent[0, 2]) < 0.9 else [1, 0, 0])
    for i in range(k):
        start = unit(start - tangent[i] * (start @ tangent[i]))
        normal[i] = start
    side = np.cross(tangent, normal)
    t = np.linspace(0, 2 * np.pi, sides + 1)
    n = normal[:, None] * np.cos(t)[None, :, None] + side[:, None] * np.sin(t)[None, :, None]
    v = path[:, None] + n * np.broadcast_to(radius, (k,))[:, None, None]
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(t[None] / (2 * np.pi), length[:, None]), -1)
    return Mesh(v.reshape(-1, 3), grid(sides, k - 1), uv.reshape(-1, 2), n.reshape(-1, 3))


def ring(radius, thickness, segments=40, sides=12):
    """A torus lying in the XY plane."""
    t = np.linspace(0, 2 * np.pi, segments + 1)
    m = tube(np.stack([radius * np.cos(t), radius * np.sin(t), 0 * t], 1), thickness, sides)
    return Mesh(m.v, m.f, m.uv * [1, 1 / (2 * np.pi * radius)], m.n)


def rounded_box(width, depth, height, radius, steps=6):
    """A box with round edges standing on z = 0: a cube's surface pushed out from a smaller box."""
    half = np.array([width, depth, height]) / 2
    inner = half - radius
    # Lattice lines crowd at the edges, where the rounding needs them.
    edge = np.sin(np.linspace(0, np.pi / 2, steps)) * 0.5 + 0.5
    line = np.concatenate([-edge[::-1], [0], edge])
    parts = []
    for axis in range(3):
        for sign in (-1, 1):
            a, b = np.meshgrid(line, line)
            p = np.zeros((a.size, 3))
            p[:, axis] = sign
            first, second = (axis + 1) % 3, (axis + 2) % 3
            p[:, first], p[:, second] = (a.ravel() * sign, b.ravel())
            outer = p * (inner + radius)
            core = np.clip(outer, -inner, inner)
            n = unit(outer - core)
            f = grid(len(line) - 1, len(line) - 1)
            uv = outer[:, [first, second]] + half[[first, second]]
            parts.append(Mesh(core + n * radius, f, uv, n))
    return merged(parts).moved(z=height / 2)


def blades(places, heights, widths, rng, bend=0.5, steps=4):
    """Grass: one thin bent strip per place, leaning any way."""
    k = len(places)
    turn = rng.uniform(0, 2 * np.pi, k)
    lean = rng.uniform(0.1, 1, k) * bend * heights
    t = np.linspace(0, 1, steps + 1)
    across = np.stack([-np.sin(turn), np.cos(turn), 0 * turn], 1)
    along = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    centre = (
        places[:, None]
        + along[:, None] * (lean[:, None] * t**2)[..., None]
        + np.array([0, 0, 1]) * (heights[:, None] * (t - 0.15 * t**2))[..., None]
    )
    half = across[:, None] * (widths[:, None] * (1 - t**2 * 0.95) / 2)[..., None]
    v = np.stack([centre - half, centre + half], 2).reshape(-1, 3)
    f = (grid(1, steps)[None] + (np.arange(k) * 2 * (steps + 1))[:, None, None]).reshape(-1, 3)
    # u picks one colour per blade, v runs from root to tip.
    uv = np.stack(np.broadcast_arrays(rng.uniform(0, 1, k)[:, None, None], t[None, :, None], np.zeros((1, 1, 2))), -1)[
        ..., :2
    ].reshape(-1, 2)
    return smoothed(Mesh(v, f, uv))


def leaf(length, width, curl=0.3, steps=6):
    """A pointed leaf along +X, folded a little along its middle and curling down."""

    def shape(u, v):
        w = width * np.sin(np.pi * np.clip(u, 0.02, 0.995)) ** 0.8 * (v - 0.5)
        return np.stack([length * u, w, 0.4 * np.abs(w) - curl * length * u**2], 1)

    return surface(shape, steps, 4)


def curtain(width, height, folds, depth, rng):
    """A hanging cloth with uneven folds, in the XZ plane."""
    phase, pitch = rng.uniform(0, 6, 3), rng.uniform(0.7, 1.3, 3) * folds * 2 * np.pi

    def shape(u, v):
        y = sum(np.sin(pitch[i] * u + phase[i]) for i in range(3)) / 3 * depth * (0.6 + 0.4 * (1 - v))
        return np.stack([(u - 0.5) * width, y, v * height], 1)

    m = surface(shape, folds * 16, 4)
    return Mesh(m.v, m.f, m.uv * [width, height], m.n)


def superquadric(east, north, columns=40, rows=24):
    """A unit superquadric: exponents of 1 make a ball, small ones a box, 2 and more a star-like diamond."""
    power = lambda a, e: np.sign(a) * np.abs(a) ** e

    def shape(u, v):
        a, b = (u - 0.5) * 2 * np.pi, (v - 0.5) * np.pi
        c = power(np.maximum(np.cos(b), 0), north)
        return np.stack([c * power(np.cos(a), east), c * power(np.sin(a), east), power(np.sin(b), north)], 1)

    return surface(shape, columns, rows)


def waves(points, rng, count=12, pitch=3.0):
    """A smooth random field over points (n,3), about -1 to 1."""
    k = rng.standard_normal((count, 3)) * pitch
    return np.sin(points @ k.T + rng.uniform(0, 6.3, count)).sum(1) / np.sqrt(count / 2) / 2


def displaced(mesh, amount, rng, pitch=3.0, octaves=2):
    """The smooth mesh pushed along its normals by a random field."""
    push = sum(waves(mesh.v, rng, 12, pitch * 2**i) / 2**i for i in range(octaves))
    return smoothed(Mesh(mesh.v + mesh.n * (push * amount)[:, None], mesh.f, mesh.uv))


def ground(size, height, rng, cells=70, pitch=0.25):
    """Hilly ground, `size` wide, of about +-`height`; texture coordinates in scene units."""

    def shape(u, v):
        p = np.stack([(u - 0.5) * size, (v - 0.5) * size, 0 * u], 1)
        p[:, 2] = height * (waves(p, rng, 10, pitch) + 0.25 * waves(p, rng, 10, pitch * 4))
        return p

    m = surface(shape, cells, cells)
    return Mesh(m.v, m.f, m.uv * size, m.n)


def knot(p, q, thickness, sides=10, steps=200):
    """A torus knot of about unit size around the origin."""
    t = np.linspace(0, 2 * np.pi, steps)
    r = 0.65 + 0.28 * np.cos(q * t)
    return tube(np.stack([r * np.cos(p * t), r * np.sin(p * t), 0.28 * np.sin(q * t)], 1), thickness, sides)


def spring(radius, height, turns, thickness, sides=6):
    t = np.linspace(0, 1, int(turns * 24) + 1)
    a = 2 * np.pi * turns * t
    return tube(np.stack([radius * np.cos(a), radius * np.sin(a), height * t], 1), thickness, sides)


def letters(text, height, depth, font):
    """Block letters standing in the XZ plane: every run of pixels of the drawn text is a box."""
    from PIL import Image, ImageDraw

    box_of = font.getbbox(text)
    image = Image.new("1", (box_of[2] + 1, box_of[3] + 1))
    ImageDraw.Draw(image).text((0, 0), text, font=font, fill=1)
    rows = np.asarray(image)
    step = height / rows.shape[0]
    parts = []
    for i, row in enumerate(rows):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(int), [0]])))
        for a, b in zip(edges[::2], edges[1::2]):
            centre = ((a + b) / 2 - rows.shape[1] / 2) * step
            parts.append(box((b - a) * step, depth, step).moved(centre, 0, height - (i + 1) * step))
    return merged(parts)
