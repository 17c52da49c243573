"""Mitsuba 3 behind the same few calls for every scene: meshes, materials, lights, a camera, rendering."""

import os
import re
from glob import glob

import mitsuba as mi
import numpy as np


def newest_llvm():
    """The newest LLVM library installed: Dr.Jit takes the first it finds, and those before 17 lack instructions."""
    found = glob("/usr/lib/*/libLLVM*.so*") + glob("/usr/lib/llvm-*/lib/libLLVM*.so*")
    return max(
        found, key=lambda path: float(re.search(r"(\d+(\.\d+)?)", path.rsplit("libLLVM", 1)[1] + "0")[1]), default=None
    )


if newest_llvm():
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", newest_llvm())
mi.set_variant("llvm_ad_rgb")

import path_features  # noqa: E402  (classes of Mitsuba exist only once a variant is set)

path_features.register()

# Samples per pixel of one launch of a reference: bounds the memory of the wavefront.
CHUNK_SAMPLES = 1 << 21


def texture(pattern, repeat=1.0, turned=False):
    """A colour (3 numbers), a grey (1 number) or an image array, as Mitsuba wants it.

    With an image, `repeat` is the number of repetitions per unit of texture coordinates.
    """
    pattern = np.asarray(pattern, np.float32)
    if pattern.ndim <= 1:
        return {"type": "rgb", "value": [float(c) for c in np.broadcast_to(pattern, 3)]}
    if pattern.ndim == 2:
        pattern = pattern[..., None]
    transform = mi.ScalarTransform4f().scale([repeat, repeat, 1])
    if turned:
        transform = mi.ScalarTransform4f().rotate([0, 0, 1], 90) @ transform
    return {"type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(pattern)), "raw": True, "to_uv": transform}


def diffuse(pattern, **kw):
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture(pattern, **kw)}}


def plastic(pattern, roughness=None, **kw):
    """Coated diffuse; smooth without `roughness`."""
    inner = {
        "type": "plastic" if roughness is None else "roughplastic",
        "diffuse_reflectance": texture(pattern, **kw),
        "nonlinear": True,
    }
    if roughness is not None:
        inner["alpha"] = roughness
    return {"type": "twosided", "bsdf": inner}


def metal(name="Al", roughness=None, tint=1.0, repeat=1.0):
    """A conductor: mirror-like without `roughness`, which may be a grey image; `tint` a colour or an image."""
    inner = {
        "type": "conductor" if roughness is None else "roughconductor",
        "material": name,
        "specular_reflectance": texture(tint, repeat=repeat),
    }
    if roughness is not None:
        inner["alpha"] = texture(roughness, repeat=repeat) if np.ndim(roughness) else float(roughness)
    return {"type": "twosided", "bsdf": inner}


def glass(roughness=None):
    if roughness is None:
        return {"type": "dielectric", "int_ior": 1.5}
    return {"type": "roughdielectric", "int_ior": 1.5, "alpha": roughness}


def pane():
    """Thin glass: light passes straight through."""
    return {"type": "thindielectric", "int_ior": 1.5}


class Stage:
    """A scene in the making."""

    def __init__(self):
        self.parts = {}
        self.cache = {}

    def add(self, mesh, material, glow=None, share=1.0):
        """A mesh; with `glow` (radiance, a colour or a number) it is a visible light.

        Lights are picked for sampling in proportion to `share`: below 1 for lamps that add little light.
        """
        name = f"part{len(self.parts):04d}"
        # Sharing one BSDF between meshes keeps the compiled kernels small.
        if id(material) not in self.cache:
            self.cache[id(material)] = (mi.load_dict(material), material)
        props = mi.Properties()
        props["bsdf"] = self.cache[id(material)][0]
        if glow is not None:
            props["emitter"] = mi.load_dict({"type": "area", "radiance": texture(glow), "sampling_weight": share})
        out = mi.Mesh(
            name,
            len(mesh.v),
            len(mesh.f),
            has_vertex_normals=mesh.n is not None,
            has_vertex_texcoords=True,
            props=props,
        )
        params = mi.traverse(out)
        params["vertex_positions"] = np.ascontiguousarray(mesh.v, np.float32).ravel()
        params["faces"] = np.ascontiguousarray(mesh.f, np.uint32).ravel()
        params["vertex_texcoords"] = np.ascontiguousarray(mesh.uv, np.float32).ravel()
        if mesh.n is not None:
            params["vertex_normals"] = np.ascontiguousarray(mesh.n, np.float32).ravel()
        params.update()
        self.parts[name] = out

    def environment(self, image, turn=0.0):
        """Light from infinitely far: a latitude-longitude image whose poles are +Z and -Z."""
        to_world = mi.ScalarTransform4f().rotate([0, 0, 1], turn) @ mi.ScalarTransform4f().rotate([1, 0, 0], 90)
        self.parts["environment"] = {
            "type": "envmap",
            "to_world": to_world,
            "bitmap": mi.Bitmap(np.ascontiguousarray(image, np.float32)),
        }

    def camera(self, origin, target, fov, aperture=None, focus=None):
        """A pinhole, or a thin lens of radius `aperture` focused on the point `focus`."""
        self.view = {
            "type": "perspective",
            "fov": fov,
            "fov_axis": "x",
            "near_clip": 1e-3,
            "far_clip": 1e5,
            "to_world": mi.ScalarTransform4f().look_at(origin, target, [0, 0, 1]),
        }
        if aperture:
            along = np.subtract(target, origin)
            along = along / np.linalg.norm(along)
            self.view |= {
                "type": "thinlens",
                "aperture_radius": aperture,
                "focus_distance": float(np.subtract(focus, origin) @ along),
            }


class Renderer:
    """Renders a finished stage; every call with another `seed` is independent."""

    def __init__(self, stage, size, clamp, max_depth):
        film = {
            "type": "hdrfilm",
            "width": size[0],
            "height": size[1],
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        }
        sensor = stage.view | {"film": film, "sampler": {"type": "independent"}}
        self.scene = mi.load_dict({"type": "scene", "sensor": sensor, **stage.parts})
        self.size = size
        shared = {"type": "feature_path", "clamp": float(clamp), "max_depth": max_depth}
        self.with_features = mi.load_dict(shared | {"features": True})
        self.colour_only = mi.load_dict(shared | {"features": False})

    def sample(self, seed):
        """One sample per pixel: a dict of channel name to (height, width) array."""
        image = np.array(mi.render(self.scene, integrator=self.with_features, spp=1, seed=seed), np.float64)
        return dict(zip(["R", "G", "B", *path_features.NAMES], np.moveaxis(image, -1, 0)))

    def mean(self, spp, seed):
        """The mean colour of `spp` samples, (height, width, 3)."""
        chunk = max(1, min(spp, CHUNK_SAMPLES // (self.size[0] * self.size[1])))
        total, done = 0.0, 0
        while done < spp:
            now = min(chunk, spp - done)
            total = total + now * np.array(
                mi.render(self.scene, integrator=self.colour_only, spp=now, seed=seed + done), np.float64
            )
            done += now
        return total[..., :3] / spp
