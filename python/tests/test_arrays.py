"""Arrays: types, strides, shapes, where results go, and what is left behind."""

import gc
import sys

import numpy as np
import pytest

import tamis


def test_strides_do_not_matter(colors):
    given, expected = colors

    def lying(array, how):
        if how == "flipped":
            return array[::-1, ::-1].copy()[::-1, ::-1]
        if how == "channels first":
            return np.moveaxis(np.moveaxis(array, -1, 0).copy(), 0, -1) if array.ndim == 3 else array
        if how == "every other":
            wide = np.zeros((2 * array.shape[0], 3 * array.shape[1], *array.shape[2:]), array.dtype)
            wide[::2, 1::3] = array
            return wide[::2, 1::3]
        if how == "reversed channels":
            return array[..., ::-1].copy()[..., ::-1] if array.ndim == 3 else np.asfortranarray(array)
        unaligned = np.zeros(array.nbytes + 1, np.uint8)[1:].view(array.dtype).reshape(array.shape)
        unaligned[...] = array
        return unaligned

    for how in ("flipped", "channels first", "every other", "reversed channels", "unaligned"):
        others = {name: lying(array, how) for name, array in given.items()}
        assert all(np.array_equal(others[name], array) for name, array in given.items())
        assert any(not array.flags.c_contiguous or not array.flags.aligned for array in others.values())
        out = lying(np.empty_like(expected), how)
        assert tamis.denoise(**others, out=out) is out
        assert np.array_equal(out, expected), how


def test_nothing_is_copied_to_be_read(frame):
    color = np.broadcast_to(np.float32(0.5), (64, 48, 3))
    assert color.strides == (0, 0, 0)
    assert np.allclose(tamis.denoise(color), 0.5, atol=1e-5)
    upside_down = frame["color"][::-1]
    assert np.array_equal(tamis.denoise(upside_down), tamis.denoise(upside_down.copy()))


def test_halves_are_their_values(colors):
    given, _ = colors
    halves = {name: array.astype(np.float16) for name, array in given.items()}
    wide = {name: array.astype(np.float32) for name, array in halves.items()}
    of_halves, of_wide = tamis.denoise(**halves), tamis.denoise(**wide)
    assert of_halves.dtype == np.float16 and of_wide.dtype == np.float32
    assert np.array_equal(of_halves, np.clip(of_wide, -65504, 65504).astype(np.float16))
    out = np.empty(of_wide.shape, np.float32)
    assert np.array_equal(tamis.denoise(**halves, out=out), of_wide)
    mixed = {**wide, "albedo": halves["albedo"]}
    assert np.array_equal(tamis.denoise(**mixed), of_wide)


def test_an_alpha_is_kept(colors):
    given, expected = colors
    alpha = np.linspace(0.1, 1, expected.shape[0] * expected.shape[1], dtype=np.float32)
    alpha = alpha.reshape(expected.shape[:2])
    rgba = np.dstack([given["color"], alpha])
    others = {name: array for name, array in given.items() if name != "color"}
    clean = tamis.denoise(rgba, **others)
    assert np.array_equal(clean[..., 3], alpha)
    assert np.array_equal(clean[..., :3], expected)
    assert np.array_equal(tamis.denoise(given["color"], **others, alpha=alpha), expected)
    # Where nothing is covered, nothing comes of it.
    alpha[:40, :40] = rgba[:40, :40] = 0
    rgba[..., 3] = alpha
    clean = tamis.denoise(rgba, **others)
    assert not clean[:40, :40].any()
    hidden = tamis.denoise(rgba[..., :3], **others, alpha=alpha)
    assert np.array_equal(clean[..., :3], hidden)


def test_results_go_where_they_are_wanted(colors):
    given, expected = colors
    color = given["color"].copy()
    assert tamis.denoise(**{**given, "color": color}, out=color) is color
    assert np.array_equal(color, expected)
    rgba = np.dstack([given["color"], np.ones(expected.shape[:2], np.float32)])
    out = np.full(rgba.shape, 7, np.float32)
    tamis.denoise(rgba, out=out)
    assert (out[..., 3] == 1).all() and (out[..., :3] != 7).any()


def test_variances_and_samples_are_read(frame):
    plain = tamis.denoise(frame["color"])
    others = [
        tamis.denoise(frame["color"], color_variance=frame["color_variance"]),
        tamis.denoise(frame["color"], samples=1),
    ]
    assert all(not np.array_equal(plain, other) for other in others)
    everything = {name: frame[name] for name in frame if name not in ("alpha", "samples")}
    assert {"position", "direct", "depth_variance"} <= set(everything)
    assert everything["depth_variance"].shape == everything["depth"].shape
    tamis.denoise(**everything)


def wrong(kind, text, *arguments, **keywords):
    with pytest.raises(kind, match=text) as error:
        tamis.denoise(*arguments, **keywords)
    assert isinstance(error.value, tamis.Error)


def test_mistakes_are_named(colors):
    given, _ = colors
    color = given["color"]
    wrong(ValueError, r"color: its shape is \(3, .*numpy.moveaxis\(color, 0, -1\)", np.moveaxis(color, -1, 0))
    wrong(ValueError, r"albedo: .*numpy.moveaxis\(albedo", color, np.moveaxis(given["albedo"], -1, 0))
    wrong(ValueError, r"depth: .*must be \(H, W\); take depth\[0\]", color, depth=given["depth"][None])
    wrong(ValueError, r"depth: its shape is .*must be \(H, W\)$", color, depth=color)
    wrong(ValueError, r"color: its shape is .*must be \(H, W, 3\) or \(H, W, 4\)$", given["depth"])
    wrong(ValueError, r"color: its shape is \(5,\)", np.zeros(5, np.float32))
    wrong(
        ValueError,
        r"albedo: it has 4 rows of 4 pixels, but color has",
        color,
        np.zeros((4, 4, 3), np.float32),
    )
    wrong(ValueError, r"alpha: it has 4 rows", color, alpha=np.zeros((4, 4), np.float32))
    wrong(ValueError, r"out: it has 4 rows", color, out=np.zeros((4, 4, 3), np.float32))
    wrong(ValueError, r"out: its shape is .*must be \(H, W, 3\)", color, out=np.zeros((4, 4, 4), np.float32))
    wrong(ValueError, r"out: it cannot be written to", color, out=np.broadcast_to(np.float32(0), color.shape))
    wrong(ValueError, r"color: it has no pixels", np.zeros((0, 4, 3), np.float32))
    wrong(TypeError, r"color: its samples are float64.*astype\(numpy.float32\)", color.astype(float))
    wrong(TypeError, r"color: its samples are uint8", np.zeros((4, 4, 3), np.uint8))
    wrong(TypeError, r"albedo: its samples are >f4", color, given["albedo"].astype(">f4"))
    wrong(TypeError, r"color: the frame has no colour", None)
    wrong(TypeError, r"out: a list", color, out=[1])
    wrong(TypeError, r"progress: it must be a function", color, progress=3)
    wrong(TypeError, r"filter: a int is none", color, filter=3)
    wrong(ValueError, r"there is no filter or file `bilatral`; filters: tamis", color, filter="bilatral")
    wrong(ValueError, r"backend: there is no `cuda`; there are auto, jit", color, backend="cuda")
    wrong(ValueError, r"precision: there is no `half`; there are standard, fast", color, precision="half")
    wrong(ValueError, r"repair: there is no `mean`", color, repair="mean")
    wrong(ValueError, r"strength of 2", color, strength=2)
    wrong(ValueError, r"threads: it is 0, but must be from 1", color, threads=0)
    wrong(TypeError, r"threads: a str is no whole number", color, threads="all")
    wrong(ValueError, r"samples: it is 0", color, samples=0)
    wrong(tamis.Error, r"the filter reads `position`", color, filter="kan2017")


def test_bad_pixels_are_repaired_and_told(colors):
    given, _ = colors
    color = given["color"].copy()
    color[20, 30] = np.nan
    with pytest.warns(tamis.ImageWarning, match="1 ") as told:
        clean = tamis.denoise(color)
    assert told[0].filename == __file__, "it names the caller's line"
    assert np.isfinite(clean).all()
    wrong(tamis.Error, r"x = 30, y = 20", color, repair="error")
    denoiser = tamis.Denoiser()
    with pytest.warns(tamis.ImageWarning) as told:
        denoiser.denoise(color)
    assert told[0].filename == __file__
    assert denoiser.report["warnings"]


def test_nothing_is_left_behind(colors):
    given, _ = colors
    out = np.empty_like(given["color"])
    denoiser = tamis.Denoiser()
    told = []

    def progress(done, of):
        told.append(done)

    def counts():
        # Exceptions and their frames know each other.
        gc.collect()
        return [sys.getrefcount(thing) for thing in [*given.values(), out, progress]]

    denoiser.denoise(**given, out=out, progress=progress)
    before = counts()
    for _ in range(3):
        denoiser.denoise(**given, out=out, progress=progress)
        with pytest.raises(ValueError):
            denoiser.denoise(**{**given, "albedo": given["depth"]}, out=out, progress=progress)
    assert counts() == before
    clean = denoiser.denoise(**given)
    other = np.empty(3)
    assert sys.getrefcount(clean) == sys.getrefcount(other)
