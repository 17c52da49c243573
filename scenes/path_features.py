"""A Mitsuba path tracer that returns the colour and every feature from the same samples.

Mitsuba's own `aov` integrator has no direct light and no secondary albedo, and a second integrator beside
it would draw other random numbers: its direct light would not share the colour's noise, which a filter
trained on real renders has to cope with. So one integrator computes them all.

Features (0 where a ray hits nothing):
- Position, Normal (interpolated shading normal, not turned towards the camera), Depth (distance to the
  ray's origin) at the first hit;
- Albedo: diffuse reflectance at the first hit; 0 on metals, glass and lights;
- SecondaryAlbedo: diffuse reflectance at the end of a chain of specular or glossy bounces (five at most)
  that starts at the first hit, also under the coat of a plastic; 0 where the first hit has no such lobe;
- Direct: light emitted towards the camera by the first hit, plus light that reaches it straight from a light.
"""

import drjit as dr
import mitsuba as mi

NAMES = [
    "Position.X",
    "Position.Y",
    "Position.Z",
    "Normal.X",
    "Normal.Y",
    "Normal.Z",
    "Albedo.R",
    "Albedo.G",
    "Albedo.B",
    "SecondaryAlbedo.R",
    "SecondaryAlbedo.G",
    "SecondaryAlbedo.B",
    "Depth.Z",
    "Direct.R",
    "Direct.G",
    "Direct.B",
]

# How many specular or glossy bounces the secondary albedo follows.
CHAIN = 5
# Bounces before Russian roulette may end a path.
ROULETTE_AFTER = 5


def diffuse_albedo(si, active):
    """Diffuse reflectance at `si`; 0 for materials without a diffuse lobe and for lights."""
    bsdf = si.bsdf()
    # `eval_diffuse_reflectance` of a metal falls back to its whole BSDF: ask the lobes first.
    diffuse = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.DiffuseReflection) & ~mi.Bool(si.shape.is_emitter())
    albedo = bsdf.eval_diffuse_reflectance(si, diffuse)
    return dr.select(diffuse, dr.clip(albedo, 0, 1), 0)


def capped(light, clamp):
    """`light`, scaled down so that no channel exceeds `clamp` (0: no clamp)."""
    if not clamp:
        return light
    peak = dr.max(light)
    return light * dr.select(peak > clamp, clamp / peak, 1)


class FeaturePath(mi.SamplingIntegrator):
    """Path tracing with next-event estimation and multiple importance sampling, plus the features above.

    Properties: `max_depth` (number of bounces), `clamp` (largest value that one light contribution may add at
    the second vertex or later; 0: none), `features` (false: colour only, for references).
    """

    def __init__(self, props):
        super().__init__(props)
        self.max_depth = props.get("max_depth", 12)
        self.clamp = props.get("clamp", 0.0)
        self.features = props.get("features", True)

    def aov_names(self):
        return list(NAMES) if self.features else []

    @dr.syntax
    def secondary(self, scene, sampler, first, active):
        """Follow the non-diffuse lobes from the first hit until something diffuse is met."""
        lobes = mi.BSDFContext()
        lobes.type_mask = int(mi.BSDFFlags.Delta) | int(mi.BSDFFlags.Glossy)
        found = mi.Color3f(0)
        si = dr.copy(first)
        bounce = mi.UInt32(0)
        active = mi.Bool(active)
        while active:
            bsdf = si.bsdf()
            active &= mi.has_flag(bsdf.flags(), mi.BSDFFlags.Delta) | mi.has_flag(bsdf.flags(), mi.BSDFFlags.Glossy)
            sample, weight = bsdf.sample(lobes, si, sampler.next_1d(active), sampler.next_2d(active), active)
            active &= (sample.pdf > 0) & (dr.max(weight) > 0)
            si = scene.ray_intersect(si.spawn_ray(si.to_world(sample.wo)), active)
            active &= si.is_valid()
            albedo = diffuse_albedo(si, active)
            bounce += 1
            reached = active & (dr.max(albedo) > 0)
            found[reached] = albedo
            active &= ~reached & (bounce < CHAIN)
        return found

    @dr.syntax
    def sample(self, scene, sampler, ray, medium=None, active=True):
        context = mi.BSDFContext()
        ray = mi.Ray3f(dr.detach(ray))
        active = mi.Bool(active)
        throughput = mi.Color3f(1)
        eta = mi.Float(1)
        colour = mi.Color3f(0)
        direct = mi.Color3f(0)
        depth = mi.UInt32(0)
        last = dr.zeros(mi.SurfaceInteraction3f)
        last_pdf = mi.Float(1)
        last_delta = mi.Bool(True)

        features = []
        if dr.hint(self.features, mode="scalar"):
            first = scene.ray_intersect(ray, active)
            hit = first.is_valid()
            albedo = diffuse_albedo(first, hit)
            second = self.secondary(scene, sampler, first, hit)
            position = dr.select(hit, first.p, 0)
            normal = dr.select(hit, first.sh_frame.n, 0)
            distance = dr.select(hit, dr.norm(first.p - ray.o), 0)

        while dr.hint(active, max_iterations=64, label="bounces"):
            si = scene.ray_intersect(ray, active)

            # Light that the ray ran into, weighted against the chance of having sampled it as a light.
            emitter = si.emitter(scene, active)
            to_light = mi.DirectionSample3f(scene, si, last)
            light_pdf = scene.pdf_emitter_direction(last, to_light, active & ~last_delta)
            weight = dr.select(last_delta, 1, last_pdf / dr.maximum(last_pdf + light_pdf, 1e-30))
            found = throughput * weight * emitter.eval(si, active)
            direct = dr.select(depth <= 1, direct + found, direct)
            colour += dr.select(depth <= 1, found, capped(found, self.clamp))

            active &= si.is_valid() & (depth < self.max_depth)
            bsdf = si.bsdf(ray)

            # One light sampled on purpose.
            lit = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
            ds, light = scene.sample_emitter_direction(si, sampler.next_2d(lit), True, lit)
            lit &= ds.pdf > 0
            wo = si.to_local(ds.d)
            value, pdf = bsdf.eval_pdf(context, si, wo, lit)
            weight = dr.select(ds.delta, 1, ds.pdf / dr.maximum(ds.pdf + pdf, 1e-30))
            found = dr.select(lit, throughput * weight * value * light, 0)
            direct = dr.select(depth == 0, direct + found, direct)
            colour += dr.select(depth == 0, found, capped(found, self.clamp))

            # The next direction.
            sample, weight = bsdf.sample(context, si, sampler.next_1d(active), sampler.next_2d(active), active)
            throughput *= weight
            eta *= sample.eta
            last = si
            last_pdf = sample.pdf
            last_delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
            ray = si.spawn_ray(si.to_world(sample.wo))
            depth += 1

            strength = dr.max(throughput)
            active &= strength > 0
            survive = dr.minimum(strength * eta * eta, 0.95)
            roulette = depth >= ROULETTE_AFTER
            active &= ~roulette | (sampler.next_1d(active) < survive)
            throughput = dr.select(roulette, throughput / dr.maximum(survive, 1e-6), throughput)

        if dr.hint(self.features, mode="scalar"):
            features = [
                position.x,
                position.y,
                position.z,
                normal.x,
                normal.y,
                normal.z,
                albedo.x,
                albedo.y,
                albedo.z,
                second.x,
                second.y,
                second.z,
                distance,
                direct.x,
                direct.y,
                direct.z,
            ]
        return colour, mi.Bool(True), features


def register():
    """Make the integrator known to `mi.load_dict` as `feature_path`."""
    mi.register_integrator("feature_path", FeaturePath)
