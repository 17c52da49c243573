"""Mitsuba 3 behind the same few calls for every scene: meshes, materials, lights, a camera, rendering."""

import os
import re
from glob import glob

import drjit as dr
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


def mirror():
    """A mirror without a tint."""
    return {"type": "twosided", "bsdf": {"type": "conductor", "material": "none"}}


def glass(roughness=None):
    if roughness is None:
        return {"type": "dielectric", "int_ior": 1.5}
    return {"type": "roughdielectric", "int_ior": 1.5, "alpha": roughness}


def pane():
    """Thin glass: light passes straight through."""
    return {"type": "thindielectric", "int_ior": 1.5}


class Translucent(mi.BSDF):
    """Diffuse both ways, like wax, paper, leaves and lampshades: light also comes through from behind."""

    def __init__(self, props):
        super().__init__(props)
        self.reflectance, self.transmittance = (
            mi.Color3f(*[float(c) for c in props[side]]) for side in ("reflectance", "transmittance")
        )
        dr.make_opaque(self.reflectance, self.transmittance)
        sides = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [mi.BSDFFlags.DiffuseReflection | sides, mi.BSDFFlags.DiffuseTransmission | sides]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def sample(self, ctx, si, sample1, sample2, active=True):
        wo = mi.warp.square_to_cosine_hemisphere(sample2)
        back = sample1 < 0.5
        out = dr.zeros(mi.BSDFSample3f)
        out.pdf = 0.5 * mi.warp.square_to_cosine_hemisphere_pdf(wo)
        out.eta = 1
        out.sampled_type = dr.select(
            back, mi.UInt32(+mi.BSDFFlags.DiffuseReflection), mi.UInt32(+mi.BSDFFlags.DiffuseTransmission)
        )
        out.sampled_component = dr.select(back, mi.UInt32(0), mi.UInt32(1))
        out.wo = mi.Vector3f(wo.x, wo.y, dr.select((si.wi.z > 0) == back, wo.z, -wo.z))
        weight = dr.select(back, self.reflectance, self.transmittance)
        return out, dr.select(active & (out.pdf > 0), 2 * weight, 0)

    def eval(self, ctx, si, wo, active=True):
        same = si.wi.z * wo.z > 0
        colour = dr.select(same, self.reflectance, self.transmittance)
        return dr.select(active, colour * dr.inv_pi * dr.abs(wo.z), 0)

    def pdf(self, ctx, si, wo, active=True):
        return dr.select(active, 0.5 * dr.inv_pi * dr.abs(wo.z), 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def eval_diffuse_reflectance(self, si, active=True):
        return dr.select(active, self.reflectance, 0)


mi.register_bsdf("translucent", Translucent)


def translucent(reflected, through):
    """Two plain colours: what comes back and what goes through."""
    return {"type": "translucent", "reflectance": texture(reflected), "transmittance": texture(through)}


class Stage:
    """A scene in the making."""

    def __init__(self):
        self.parts = {}
        self.cache = {}
        # More settings of the integrator (see path_features), and how far the camera moves while a picture is taken.
        self.habits = {}
        self.drift = None

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
        self.eye = np.asarray(origin, float)
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

    def spot(self, origin, target, intensity, cutoff):
        """A light without size that shines in a cone of `cutoff` degrees (half its opening)."""
        self.parts[f"spot{len(self.parts):04d}"] = {
            "type": "spot",
            "to_world": mi.ScalarTransform4f().look_at(
                [float(c) for c in origin], [float(c) for c in target], [0.1, 0.2, 1]
            ),
            "intensity": {"type": "rgb", "value": [float(c) for c in np.broadcast_to(intensity, 3)]},
            "cutoff_angle": float(cutoff),
            "beam_width": float(cutoff) * 0.8,
        }

    def fog(self, density, albedo, centre, radius):
        """Fog in a ball: `density` scattering events per unit of length, of `albedo` (a colour)."""
        self.habits["fog"] = (float(density), [float(c) for c in albedo], [float(c) for c in centre], float(radius))

    def motion(self, shift, turn=0.0):
        """Motion blur by a moving camera: `shift` (world units) and `turn` (degrees about +Z) from start to end.

        Only `Renderer.each` and `Renderer.colour` know it.
        """
        self.drift = (np.asarray(shift, float), float(turn))


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
        self.drift, self.eye = stage.drift, stage.eye
        shared = {"type": "feature_path", "clamp": float(clamp), "max_depth": max_depth}
        self.with_features = mi.load_dict(shared | {"features": True})
        self.colour_only = mi.load_dict(shared | {"features": False})
        for integrator in (self.with_features, self.colour_only):
            for habit, value in stage.habits.items():
                setattr(integrator, habit, value)

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

    def set_clamp(self, clamp):
        for integrator in (self.with_features, self.colour_only):
            integrator.clamp = float(clamp)

    def expose_lamps(self, exposure):
        """Lamps' albedo, where a stage asks for it, follows the picture's exposure."""
        self.with_features.lamp_albedo *= float(exposure)

    def rays(self, spp, seed):
        """The wavefront of `spp` samples per pixel, a pixel's samples side by side: a sampler and camera rays."""
        width, height = self.size
        sensor, count = self.scene.sensors()[0], width * height * spp
        sampler = sensor.sampler().fork()
        sampler.set_sample_count(1)
        sampler.seed(seed, count)
        pixel = dr.arange(mi.UInt32, count) // dr.opaque(mi.UInt32, spp)
        # Opaque: pictures of every size share their kernels.
        wide, high = dr.opaque(mi.UInt32, width), dr.opaque(mi.UInt32, height)
        corner = mi.Point2f(mi.Float(pixel % wide), mi.Float(pixel // wide))
        film = (corner + sampler.next_2d()) / mi.Point2f(mi.Float(wide), mi.Float(high))
        ray, _ = sensor.sample_ray(0, 0, film, sampler.next_2d())
        if self.drift is not None:
            time = sampler.next_1d() - 0.5
            shift, turn = self.drift
            sine, cosine = dr.sincos(dr.deg2rad(turn) * time)
            about = lambda a: mi.Vector3f(cosine * a.x - sine * a.y, sine * a.x + cosine * a.y, a.z)
            eye, shift = (mi.Vector3f(*map(float, a)) for a in (self.eye, shift))
            ray.o = mi.Point3f(about(ray.o - eye) + eye + shift * time)
            ray.d = about(ray.d)
        return sampler, ray

    def each(self, spp, seed):
        """Every single sample: a dict of channel name to (spp, height, width) array."""
        width, height = self.size
        sampler, ray = self.rays(spp, seed)
        colour, _, features = self.with_features.sample(self.scene, sampler, ray)
        planes = [colour.x, colour.y, colour.z, *features]
        dr.eval(planes)
        names = ["R", "G", "B", *path_features.NAMES]
        return {n: np.array(p).reshape(height, width, spp).transpose(2, 0, 1) for n, p in zip(names, planes)}

    def colour(self, spp, seed):
        """The mean colour of `spp` samples, (height, width, 3), without features."""
        width, height = self.size
        sampler, ray = self.rays(spp, seed)
        colour, _, _ = self.colour_only.sample(self.scene, sampler, ray)
        dr.eval(colour)
        mean = [dr.block_reduce(dr.ReduceOp.Add, c, spp) for c in (colour.x, colour.y, colour.z)]
        dr.eval(mean)
        return np.stack([np.array(c, np.float64).reshape(height, width) for c in mean], -1) / spp
