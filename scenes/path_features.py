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

Two renderers' habits can be had: `lamp_albedo` writes the light that a lamp or the sky sends (times that number) as
its albedo, well above 1, and `facing` turns normals towards the camera; both are what Cycles does.

Fog is one homogeneous, isotropically scattering medium that fills a ball; features are those of the surfaces behind it.
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
    """`light`, scaled down so that no channel exceeds `clamp`."""
    peak = dr.max(light)
    return light * dr.select(peak > clamp, clamp / peak, 1)


def chord(ray, centre, radius):
    """Where `ray` enters and leaves the ball: two distances, equal where it misses."""
    to = centre - ray.o
    middle = dr.dot(to, ray.d)
    half = dr.sqrt(dr.maximum(radius * radius - dr.squared_norm(to) + middle * middle, 0))
    return dr.maximum(middle - half, 0), dr.maximum(middle + half, 0)


class FeaturePath(mi.SamplingIntegrator):
    """Path tracing with next-event estimation and multiple importance sampling, plus the features above.

    Properties: `max_depth` (number of bounces), `clamp` (largest value that one light contribution may add at
    the second vertex or later; 0: none), `features` (false: colour only, for references). Attributes: `lamp_albedo` (0:
    lamps have none), `facing`, `fog`.
    """

    def __init__(self, props):
        super().__init__(props)
        self.max_depth = props.get("max_depth", 12)
        self.clamp = props.get("clamp", 0.0)
        self.features = props.get("features", True)
        self.lamp_albedo, self.facing = 0.0, False
        # Density, albedo (three numbers), centre (three numbers) and radius.
        self.fog = None

    def aov_names(self):
        return list(NAMES) if self.features else []

    def mist(self):
        """The fog as variables: another fog needs no other kernel."""
        density, tint, centre, radius = self.fog or (0.0, (0, 0, 0), (0, 0, 0), 0.0)
        out = mi.Float(density), mi.Color3f(*tint), mi.Point3f(*centre), mi.Float(radius)
        dr.make_opaque(out)
        return out

    def scatter(self, ray, si, mist, sampler, active):
        """Whether the fog scatters the ray before it reaches the surface `si`, and where."""
        if self.fog is None:
            return mi.Bool(False), si.p
        density, _, centre, radius = mist
        enter, leave = chord(ray, centre, radius)
        flight = enter - dr.log(1 - sampler.next_1d(active)) / density
        return active & (flight < dr.minimum(leave, si.t)), ray(flight)

    def fog_light(self, si, ds, mist, scattered, value, pdf, light):
        """A light's contribution at a point in the fog, or through fog at a surface."""
        if self.fog is None:
            return value, pdf, light
        density, tint, centre, radius = mist
        enter, leave = chord(mi.Ray3f(si.p, ds.d), centre, radius)
        # The sky gives a distance too, which means nothing.
        sky = mi.has_flag(ds.emitter.flags(), mi.EmitterFlags.Infinite)
        leave = dr.select(sky, leave, dr.minimum(leave, ds.dist))
        light = light * dr.exp(-density * dr.maximum(leave - enter, 0))
        value = dr.select(scattered, tint * dr.inv_four_pi, value)
        return value, dr.select(scattered, dr.inv_four_pi, pdf), light

    def fog_turn(self, mist, spot, scattered, weight, pdf, delta, way, eta):
        """The next direction, where the fog has scattered the path."""
        if self.fog is None:
            return weight, pdf, delta, way, eta
        return (
            dr.select(scattered, mist[1], weight),
            dr.select(scattered, dr.inv_four_pi, pdf),
            delta & ~scattered,
            dr.select(scattered, mi.warp.square_to_uniform_sphere(spot), way),
            dr.select(scattered, 1, eta),
        )

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
        # Opaque: another clamp needs no other kernel.
        clamp = dr.opaque(mi.Float, self.clamp or dr.largest(mi.Float))
        mist = self.mist()
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
            if dr.hint(self.lamp_albedo > 0, mode="scalar"):
                albedo += first.emitter(scene, active).eval(first, active) * dr.opaque(mi.Float, self.lamp_albedo)
            if dr.hint(self.facing, mode="scalar"):
                normal = dr.select(dr.dot(normal, ray.d) > 0, -normal, normal)

        while dr.hint(active, max_iterations=64, label="bounces"):
            si = scene.ray_intersect(ray, active)

            # Where the fog scatters the ray, the surface behind is not reached.
            scattered, place = self.scatter(ray, si, mist, sampler, active)

            # Light that the ray ran into, weighted against the chance of having sampled it as a light.
            seen = active & ~scattered
            emitter = si.emitter(scene, seen)
            to_light = mi.DirectionSample3f(scene, si, last)
            light_pdf = scene.pdf_emitter_direction(last, to_light, seen & ~last_delta)
            weight = dr.select(last_delta, 1, last_pdf / dr.maximum(last_pdf + light_pdf, 1e-30))
            found = throughput * weight * emitter.eval(si, seen)
            direct = dr.select(depth <= 1, direct + found, direct)
            colour += dr.select(depth <= 1, found, capped(found, clamp))

            active &= (si.is_valid() | scattered) & (depth < self.max_depth)
            bsdf = si.bsdf(ray)
            si.p = dr.select(scattered, place, si.p)
            si.n = dr.select(scattered, mi.Normal3f(0), si.n)

            # One light sampled on purpose.
            lit = active & (scattered | mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth))
            ds, light = scene.sample_emitter_direction(si, sampler.next_2d(lit), True, lit)
            lit &= ds.pdf > 0
            wo = si.to_local(ds.d)
            value, pdf = bsdf.eval_pdf(context, si, wo, lit & ~scattered)
            value, pdf, light = self.fog_light(si, ds, mist, scattered, value, pdf, light)
            weight = dr.select(ds.delta, 1, ds.pdf / dr.maximum(ds.pdf + pdf, 1e-30))
            found = dr.select(lit, throughput * weight * value * light, 0)
            direct = dr.select(depth == 0, direct + found, direct)
            colour += dr.select(depth == 0, found, capped(found, clamp))

            # The next direction.
            choice, spot = sampler.next_1d(active), sampler.next_2d(active)
            sample, weight = bsdf.sample(context, si, choice, spot, active & ~scattered)
            delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
            weight, last_pdf, last_delta, way, bend = self.fog_turn(
                mist, spot, scattered, weight, sample.pdf, delta, si.to_world(sample.wo), sample.eta
            )
            eta *= bend
            throughput *= weight
            last = si
            ray = si.spawn_ray(way)
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
