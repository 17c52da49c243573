#!/usr/bin/env python3
"""Writes the form of a shipped program, with constants to start tuning from.

    scripts/forms.py tamis|tamis-fast > form.toml

A form is a filter file whose constants are guesses and whose layers are random and at rest: what
they give is zero until they are tuned. `scripts/tune_filters` tunes them. docs/filters/ says what
the stages are for.
"""

import math
import random
import sys

# What statistics are brought to mean 0 and deviation 1 by: their means and deviations over
# every eleventh scene of data/corpus/train at 1, 4 and 64 samples. Those of sample counts, grain
# and doubts are guesses.
NORMS = {
    "grey": (0.14, 0.64), "near": (0.35, 0.66), "middle": (-0.19, 0.59), "near middle": (-0.07, 0.32),
    "noise": (-0.13, 1.87), "near noise": (-0.25, 1.96), "own noise": (-0.83, 1.17), "near own": (-0.76, 1.12),
    "swing": (-0.82, 1.72), "middle swing": (-1.96, 1.47),
    "edge albedo": (-3.89, 1.73), "edge normal": (-4.07, 2.04), "edge reflected": (-4.81, 1.64), "edge depth": (-4.34, 1.68),
    "wide albedo": (-3.52, 1.65), "wide normal": (-3.46, 2.04), "wide reflected": (-4.55, 1.74), "wide depth": (-4.0, 1.73),
    "noise normal": (-4.68, 1.48), "noise albedo": (-4.66, 1.27), "noise reflected": (-5.09, 1.25), "noise depth": (-5.64, 1.5),
    "albedo": (0.35, 0.2), "black": (0.07, 0.25), "normal": (0.29, 0.09),
    "measured": (0.5, 0.5), "samples": (1.5, 1.7), "counted": (0.5, 0.5), "grain": (-4.0, 2.5), "median grain": (-3.0, 2.5),
    "guide noise": (-2.46, 1.2), "guide near": (0.47, 0.78), "guide grey": (0.26, 0.53), "guide middle": (-0.06, 0.31), "guide": (-0.13, 0.44),
    "doubt": (-1.64, 1.36), "wide doubt": (-1.4, 1.2), "change": (-0.28, 2.29), "gain": (-0.04, 0.32),
}


# Hidden units of a layer.
UNITS = 16


class Form:
    """A filter file in the making."""

    def __init__(self, name, absent):
        self.name, self.absent = name, absent
        self.params, self.layers, self.stages = [], [], []
        self.random = random.Random(1)

    def param(self, name, value, bounds=None):
        """A constant."""
        self.params.append((name, value, bounds))

    def scale(self, name, value, share):
        """A positive constant, from value / share to value * share: tuned by its logarithm."""
        self.param(name, value, (value / share, value * share))

    def layer(self, name, rows, columns, at_rest=False):
        """A layer of random numbers, or one that gives zero."""
        deviation = 0.0 if at_rest else 1.0 / math.sqrt(columns)
        weights = [[deviation * self.random.gauss(0, 1) for _ in range(columns)] for _ in range(rows)]
        self.layers.append((name, weights, [0.0] * rows))

    def map(self, name, formula, half=False):
        self.stages.append((name, [("map", formula)], half))

    def gather(self, name, of, weight, dilation=1, variance=None, half=False, radius=1):
        rows = [("gather", of), ("weight", weight), ("radius", radius)]
        rows += [("dilation", dilation)] if dilation != 1 else []
        rows += [("variance", variance)] if variance else []
        self.stages.append((name, rows, half))

    def text(self):
        lines = ["version = 2", f'name = "{self.name}"', "", "[absent]"]
        lines += [f"{feature} = {value}" for feature, value in self.absent.items()]
        lines += ["", "[params]"]
        lines += [f"{name} = {value!r}" for name, value, bounds in self.params if not bounds]
        for name, value, bounds in self.params:
            if bounds:
                lines += ["", f"[params.{name}]", f"value = {value!r}", f"min = {bounds[0]!r}", f"max = {bounds[1]!r}"]
        for name, weights, bias in self.layers:
            rows = ", ".join("[" + ", ".join(f"{x:.6g}" for x in row) + "]" for row in weights)
            lines += ["", f"[layers.{name}]", f"bias = {bias}", f"weights = [{rows}]"]
        for name, rows, half in self.stages:
            lines += ["", "[[stage]]", f'name = "{name}"']
            lines += [f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value}" for key, value in rows]
            lines += ['grid = "half"'] if half else []
        return "\n".join(lines) + "\n"


def shifted(x, dx, dy):
    return f"{x}[{dx}, {dy}]" if dx or dy else x


def median(x):
    """The median of the nine pixels around each."""
    return "median(" + ", ".join(shifted(x, dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1)) + ")"


def edges(x):
    """How much a feature changes across a pixel: the same for a flipped image."""
    return f"mean(pow({x}[1, 0] - {x}[-1, 0], 2) + pow({x}[0, 1] - {x}[0, -1], 2))"


def slope(x):
    """The smaller one of the differences to either side, 0 where they have two signs."""
    def along(dx, dy):
        sides = f"{x} - {shifted(x, -dx, -dy)}, {shifted(x, dx, dy)} - {x}"
        return f"max(min({sides}), 0) + min(max({sides}), 0)"
    return f"join({along(1, 0)}, {along(0, 1)})"


def apart(x, noise, sigma, mu):
    """How far i and j are apart in a feature, less what its noise explains."""
    return f"max(pow(distance2({x}, {x}), 2) - {sigma} * {noise}[i], 0) / (1 + {mu} * {noise}[i])"


def statistics(form, name, rows):
    """Joins statistics of mean 0 and deviation 1, at half resolution."""
    terms = []
    for label, formula in rows:
        mean, deviation = NORMS[label]
        terms.append(f"({formula} {'-' if mean >= 0 else '+'} {abs(mean)}) * {1 / deviation:.4g}")
    form.map(name, f"clamp(join({', '.join(terms)}), -4, 4)", half=True)
    return len(rows)


def log_ratio(x, to="level"):
    return f"log((max({x}, 0) + 0.02) / ({to} + 0.02))"


def half_log(x, least):
    return f"0.5 * log({x} + {least})"


def program(name, first, second, cleans):
    """A program of two stages of passes and a clean-up.

    first, second, cleans: how many pixels the 3x3 taps are apart, of the passes at half and at full
    resolution and of those that clean up.
    """
    f = Form(name, {"albedo": 0.5, "depth": 0.0, "normal": 0.0, "secondaryAlbedo": 0.0})

    # The light: what is left of the colour without the surface's own.
    f.scale("ks", 0.1, 50)
    f.scale("delta", 0.35, 20)
    f.scale("ke", 1.0, 10)
    f.map("base", "albedo + ks * secondaryAlbedo + delta")
    f.map("light", "color / base")
    # An estimate of the variance is mostly texture where it exceeds what the image has as a whole.
    f.scale("kg", 10.0, 100)
    f.map("variance", "measured * cVariance + (1 - measured) * min(ke * cVariance, kg * grain[0] * pow(max(mean(color), 0) + 0.02, 2))")
    f.map("light_noise", "variance / pow(mean(base), 2)")
    f.map("grey", "mean(light)")
    f.map("log_depth", "log(abs(depth) + 0.01)")
    f.map("depth_noise", "min(dVariance / pow(abs(depth) + 0.01, 2), 1)")
    f.map("middle", median("grey"))
    f.map("own_noise", "min((light_noise + 0.0001) / pow(max(grey, 0) + 0.02, 2), 4)")
    f.map("edges", f"join({edges('albedo')}, {edges('normal')}, {edges('secondaryAlbedo')}, min({edges('log_depth')}, 4))")
    near = ["middle", "grey", "light_noise", "nVariance * measured", "tVariance * measured",
            "secTexVariance * measured", "depth_noise * measured", "own_noise", "edges"]
    f.gather("near", f"join({', '.join(near)})", "1", half=True)
    middle, grey, noise, noise_n, noise_a, noise_s, noise_z, own, edge_a, edge_n, edge_s, edge_z = (
        f"near[{k}]" for k in range(12))
    f.map("tint_noise", f"{noise_a} + ks * ks * {noise_s}", half=True)
    f.map("swing", f"join(pow(grey - {grey}, 2), pow(middle - {middle}, 2))", half=True)
    f.gather("wide", f"join({middle}, {noise}, {edge_a}, {edge_n}, {edge_s}, {edge_z}, swing)", "1", half=True, radius=2)
    f.map("level", "max(wide[0], 0)", half=True)

    # Fireflies: a sample that outshines its surroundings, and whose mean is noisy, counts less.
    f.scale("kr", 0.2, 100)
    f.scale("kb", 0.002, 100)
    f.scale("kf", 3.0, 20)
    f.param("pf", 1.0, (0.1, 3.0))
    f.map("noise", f"min({noise}, kr * {own} * pow(max(grey, 0) + 0.02, 2))")
    f.map("unsure", "own_noise / (own_noise + kb)")
    f.map("trust", "1 / (1 + exp(2 * pf * log((max(grey, 0) + 0.0001) / (kf * (level + 0.02)))))")
    f.map("sure", "exp(unsure * log(trust))")

    # The first stage's planes, at half resolution.
    f.map("coarse_sure", "sure", half=True)
    f.map("sure_light", "light * sure")
    f.map("sure_noise", "noise * pow(sure, 2)")
    f.map("coarse_light", "sure_light / coarse_sure", half=True)
    f.map("coarse_noise", "0.25 * sure_noise / pow(coarse_sure, 2)", half=True)
    f.map("coarse_spark", "-log(coarse_sure)", half=True)
    f.map("coarse_depth", "log_depth", half=True)
    f.map("coarse_slope", slope("coarse_depth"), half=True)
    f.map("slope", slope("log_depth"))

    # What layers see. None of it is a level of light, so that exposure does not matter.
    count = statistics(f, "stats", [
        ("near noise", half_log(f"{noise} / pow(max({middle}, 0) + 0.02, 2)", "1e-6")),
        ("middle swing", half_log("wide[7] / pow(level + 0.02, 2)", "1e-6")),
        ("wide normal", half_log("wide[3]", "1e-5")), ("grain", half_log("grain[0]", "1e-8")),
        ("grey", log_ratio("grey")), ("near", log_ratio(grey)), ("middle", log_ratio("middle")), ("near middle", log_ratio(middle)),
        ("noise", half_log("wide[1] / pow(level + 0.02, 2)", "1e-6")),
        ("own noise", half_log("own_noise", "0.0001")), ("near own", half_log(own, "0.0001")),
        ("swing", half_log("wide[6] / pow(level + 0.02, 2)", "1e-6")),
        ("edge albedo", half_log(edge_a, "1e-5")), ("edge normal", half_log(edge_n, "1e-5")),
        ("edge reflected", half_log(edge_s, "1e-5")), ("edge depth", half_log(edge_z, "1e-6")),
        ("wide albedo", half_log("wide[2]", "1e-5")),
        ("wide reflected", half_log("wide[4]", "1e-5")), ("wide depth", half_log("wide[5]", "1e-6")),
        ("noise normal", half_log(noise_n, "1e-5")), ("noise albedo", half_log(noise_a, "1e-5")),
        ("noise reflected", half_log(noise_s, "1e-5")), ("noise depth", half_log(noise_z, "1e-6")),
        ("albedo", "mean(min(albedo, 1))"), ("black", "exp(-40 * mean(albedo))"), ("normal", "mean(normal * normal)"),
        ("measured", "measured"), ("samples", "log(samples + 1)"), ("counted", "min(samples, 1)"),
        ("median grain", half_log("grain[1]", "1e-8")),
    ])
    for feature, mu, sigma in (("n", 20.0, 0.3), ("a", 300.0, 1.0), ("z", 1000.0, 0.6)):
        f.scale(f"mu_{feature}", mu, 100)
        f.scale(f"sig_{feature}", sigma, 50)
    surface = apart("base", "tint_noise", "sig_a", "mu_a")
    facing = apart("normal", noise_n, "sig_n", "mu_n")
    f.scale("tau1", 0.003, 100)
    f.scale("tau2", 0.01, 100)

    def stage(number, passes, light, light_noise, half, stats, count):
        """Passes whose bandwidths a layer gives. The names of the last one's result and noise."""
        knobs = [("sp", -0.5), ("n", 3.0), ("a", 3.5), ("z", 5.0), ("q", 0.0)]
        knobs += [] if half else [("g", 0.0)]
        # Surfaces are the same for all passes; what is filtered is not.
        shared = [knob for knob, _ in knobs if knob in ("n", "a", "z")]
        own_knobs = [knob for knob, _ in knobs if knob not in shared] + ["t"]
        def place(k, knob):
            return shared.index(knob) if knob in shared else len(shared) + k * len(own_knobs) + own_knobs.index(knob)
        f.layer(f"hidden{number}", UNITS, count)
        f.layer(f"out{number}", len(shared) + len(own_knobs) * len(passes), UNITS, at_rest=True)
        f.map(f"learnt{number}", f"out{number}(leaky(hidden{number}({stats})))", half=True)
        for k, (p, dilation) in enumerate(passes):
            learnt = lambda knob: f"learnt{number}[{place(k, knob)}]"
            for knob, start in [*knobs, ("be", 1.0), ("ka", 0.0), ("own", 0.0)]:
                f.param(f"{knob}_p{p}", start)
            if k == 0:
                terms = ", ".join(learnt(knob) for knob in shared)
                f.map(f"share{number}", f"exp(clamp(join({terms}), -9, 10))", half=True)
            terms = ", ".join(f"{knob}_p{p} + {learnt(knob)}" for knob in own_knobs[:-1])
            f.map(f"k{p}", f"exp(clamp(join({terms}), -9, 10))", half=True)
            f.map(f"l{p}", f"max(mean({light}), 0) + 0.02", half)
            f.map(f"q{p}", f"log(max({light}, 0) + 0.02)", half)
            f.map(f"r{p}", f"{light_noise} / pow(l{p}, 2)", half)
            spark = "coarse_spark" if half else "spark"
            f.map(f"t{p}", f"clamp(be_p{p} * {spark} + ka_p{p} * 0.5 * log(r{p} + 0.0001) + {learnt('t')}, -6, 12)", half)
            depth, sloped = ("coarse_depth", "coarse_slope") if half else ("log_depth", "slope")
            step = f"(offset[0] * {sloped}[0] + offset[1] * {sloped}[1]){' / 2' if half else ''}"
            distances = {
                "sp": f"pow(distance2(pixel, pixel) / {dilation}, 2)",
                "n": facing,
                "a": surface,
                "z": f"max(pow({depth}[j] - {depth}[i] - {step}, 2) - sig_z * {noise_z}[i], 0) / (1 + mu_z * {noise_z}[i])",
                "q": f"pow(distance2(q{p}, q{p}), 2) / (tau1 + 2 * r{p}[i])",
                "g": "pow(distance2(guide, guide), 2) / (tau2 + 2 * guide_noise[i])",
            }
            def times(knob):
                if knob in shared:
                    return f"exp({knob}_p{p}) * share{number}[{shared.index(knob)}]"
                return f"k{p}[{own_knobs.index(knob)}]"
            exponent = " + ".join(f"{times(knob)} * {distances[knob]}" for knob, _ in knobs)
            weight = f"exp(-min(t{p}[j] + own_p{p} * max(1 - distance2(pixel, pixel), 0) + {exponent}, 60))"
            f.gather(f"p{p}", light, weight, dilation, light_noise, half)
            light, light_noise = f"p{p}", f"p{p}.variance"
        return light, light_noise

    numbered = list(enumerate([*first, *second]))
    result, result_noise = stage(1, numbered[: len(first)], "coarse_light", "coarse_noise", True, "stats", count)

    # What the second stage knows of the first.
    f.map("guide_level", f"max(mean({result}), 0) + 0.02", half=True)
    f.map("guide", f"log(max({result}, 0) + 0.02)", half=True)
    f.map("guide_noise", f"{result_noise} / pow(guide_level, 2)", half=True)
    f.scale("kf2", 10.0, 20)
    f.scale("ks2", 0.1, 50)
    f.map("spark", "unsure * max(log((max(grey, 0) + 0.0001) / (kf2 * guide_level)), 0)")
    f.map("calm", "exp(-(ks2 * spark))")
    f.map("calm_light", "light * calm")
    f.map("calm_noise", "noise * pow(calm, 2)")
    count += statistics(f, "more", [
        ("guide noise", half_log("guide_noise", "1e-6")), ("guide near", f"log((max({grey}, 0) + 0.02) / guide_level)"),
        ("guide grey", "log((max(grey, 0) + 0.02) / guide_level)"), ("guide middle", "log((max(middle, 0) + 0.02) / guide_level)"),
        ("guide", "log(guide_level / (level + 0.02))"),
    ])
    f.map("stats2", "join(stats, more)", half=True)
    result, _ = stage(2, numbered[len(first):], "calm_light", "calm_noise", False, "stats2", count)

    # The clean-up, in the colour itself.
    f.map("color0", f"{result} * base")
    f.layer("hidden3", UNITS, count)
    f.layer("out3", 6 * len(cleans), UNITS, at_rest=True)
    f.map("learnt3", "out3(leaky(hidden3(stats2)))", half=True)
    for k, dilation in enumerate(cleans):
        learnt = lambda n: f"learnt3[{6 * k + n}]"
        color, starts = f"color{k}", {"q": 2.0, "sp": 0.0, "n": 2.0, "a": 3.0, "u": 0.5, "qu": -2.0, "b": 2.0}
        for knob, start in starts.items():
            f.param(f"{knob}_c{k}", start)
        f.map(f"log_c{k}", f"log(max({color}, 0) + 0.02)")
        f.map(f"grey_c{k}", f"max(mean({color}), 0)")
        f.map(f"spark_c{k}", f"clamp(log((grey_c{k} + 0.02) / (max({median(f'grey_c{k}')}, 0) + 0.02)), 0, 3)")
        f.map(f"k_c{k}", f"exp(clamp(join(sp_c{k}, n_c{k}, a_c{k}) + join({learnt(0)}, {learnt(1)}, {learnt(2)}), -9, 10))", half=True)
        f.map(f"q_k{k}", f"exp(clamp(q_c{k} + qu_c{k} * spark_c{k} + {learnt(3)}, -9, 10))")
        f.map(f"t_c{k}", f"u_c{k} * spark_c{k} + clamp({learnt(4)}, -6, 6)")
        exponent = (f"t_c{k}[j] + k_c{k}[0] * pow(distance2(pixel, pixel) / {dilation}, 2) + k_c{k}[1] * {facing} + "
                    f"k_c{k}[2] * {surface} + q_k{k}[i] * pow(distance2(log_c{k}, log_c{k}), 2)")
        f.gather(f"clean{k}", color, f"exp(-min({exponent}, 60))", dilation)
        f.map(f"color{k + 1}", f"{color} + logistic(b_c{k} + {learnt(5)}) * (clean{k} - {color})")

    # Where the result differs from the noisy image by less than the noise explains, it is taken.
    color = f"color{len(cleans)}"
    f.scale("kd", 0.06, 100)
    f.map("change", f"join(mean(({color} - color) * ({color} - color)), max(variance, kd * {own} * pow(max(mean({color}), 0), 2)))")
    f.gather("changed", "change", "1", half=True)
    f.gather("changed_wide", "changed", "1", half=True, radius=2)
    f.map("doubts", "clamp(join(log((changed[0] + 1e-8) / (changed[1] + 1e-8)), log((changed_wide[0] + 1e-8) / (changed_wide[1] + 1e-8))), -4, 4)", half=True)
    for k, start in enumerate((6.0, -0.8, -0.8)):
        f.param(f"bl{k}", start)
    count += statistics(f, "last", [
        ("doubt", "doubts[0]"), ("wide doubt", "doubts[1]"),
        ("change", half_log(f"changed[1] / pow(max(mean({color}), 0) + 0.02, 2)", "1e-6")),
        ("gain", log_ratio(f"mean({color})", "max(mean(color), 0)")),
    ])
    f.layer("hidden4", 12, count)
    f.layer("out4", 1, 12, at_rest=True)
    f.map("blend", f"bl0 + bl1 * doubts[0] + bl2 * doubts[1] + out4(leaky(hidden4(join(stats2, last))))[0]", half=True)
    f.map("result", f"logistic(blend) * {color} + logistic(-blend) * color")
    return f


FORMS = {
    "tamis": lambda: program("tamis", (1, 2, 4), (1, 2, 4, 8), (1, 2)),
    "tamis-fast": lambda: program("tamis-fast", (1, 2, 4), (1, 8), (1,)),
}

if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] not in FORMS:
        sys.exit(__doc__)
    sys.stdout.write(FORMS[sys.argv[1]]().text())
