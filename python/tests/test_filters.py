"""Filters as objects, tuned and searched for; pictures."""

import copy
import pathlib
import pickle
import struct
import zlib

import numpy as np
import pytest

import tamis
from conftest import SCENES, run


def test_filters_are_found_by_name_file_and_formula(tmp_path, colors):
    given, expected = colors
    best = tamis.Filter("tamis")
    assert best.name == "tamis" and best.stages > 1 and best.nodes > 100
    assert {"color", "albedo", "normal"} <= set(best.features)
    best.save(tmp_path / "mine.toml")
    for same in (best, str(tmp_path / "mine.toml"), tmp_path / "mine.toml"):
        assert np.array_equal(tamis.denoise(**given, filter=same), expected)
    weight = tamis.Filter("exp(-distance2(normal, normal) / 0.1)")
    assert weight.stages == 1 and weight.features == ["normal", "color"]
    assert weight._repr_latex_().startswith("$w(i, j) = ") and best._repr_latex_() is None
    assert "exp(" in repr(weight) and "tamis" in repr(best)
    with pytest.raises(FileNotFoundError):
        tamis.Filter.read(tmp_path / "none.toml")
    with pytest.raises(tamis.Error, match="the filter's text"):
        tamis.Filter.from_toml("version = 2")


def test_filters_are_values():
    one, same, other = tamis.Filter("tamis"), tamis.Filter("tamis"), tamis.Filter("bilateral")
    assert one == same and hash(one) == hash(same) and one != other and one != 3
    assert pickle.loads(pickle.dumps(one)) == one and copy.deepcopy(other) == other
    assert len({one, same, other}) == 2


def test_constants_are_tuned(tmp_path):
    scenes = [(path, path.with_name("reference.exr")) for path in SCENES]
    told = []
    arguments = dict(steps=2, seed=3, batch=2, crop=32, layer_rate=0.01)
    tuned = tamis.tune(
        "tamis-formula",
        scenes[:1],
        validate=scenes[1:2],
        progress=lambda step, of: told.append((step, of)),
        **arguments,
    )
    assert told[-1] == (2, 2)
    folder = SCENES[0].parent
    status, _, error = run(
        "tune", "tamis-formula", "-o", tmp_path / "mine.toml", "--scenes", folder,
        "--validate", SCENES[1].parent, "--steps", 2, "--seed", 3, "--batch", 2, "--crop", 32,
        "--layer-rate", 0.01,
    )  # fmt: skip
    assert status == 0, error
    # Pairs of files are of no sample count; folders say it, and are what the program was given.
    again = tamis.tune("tamis-formula", folder, validate=[SCENES[1].parent], **arguments)
    expected = tamis.Filter.read(tmp_path / "mine.toml")
    assert again.to_toml().split("\n", 2)[2] == expected.to_toml().split("\n", 2)[2]
    assert tuned.name == "tamis-formula"


def test_parameters_that_make_no_sense_are_named():
    def refused(kind, text, **parameters):
        with pytest.raises(kind, match=text) as error:
            tamis.tune("tamis-formula", SCENES[0].parent, **parameters)
        assert isinstance(error.value, tamis.Error)

    refused(TypeError, "pace: there is no such parameter; there are batch, clean", pace=3)
    refused(TypeError, "batch: it is 'x', but must be like 4", batch="x")
    refused(ValueError, "rate: it is nan", rate=float("nan"))
    refused(ValueError, "steps", steps=0)
    refused(ValueError, "backend: there is no `gpu`; there are jit, interp", backend="gpu")
    refused(ValueError, "a parameter: .*slow", loss="slow")
    with pytest.raises(tamis.Error):
        tamis.tune("tamis-formula", pathlib.Path("no/such/folder"))


def test_searches_find_filters(colors):
    given, _ = colors
    search = tamis.Search(
        "quick",
        seed=2,
        generations=1,
        population=4,
        children=4,
        tune_steps=1,
        finish_steps=2,
        crop=16,
        exam=16,
    )
    with pytest.raises(tamis.Error, match="call fit"):
        search.latex()
    assert search.fit([SCENES[0].parent], validate=SCENES[1].parent) is search
    rows = search.equations_
    rows = rows if isinstance(rows, list) else rows.to_dict("records")
    assert rows and search.get_best()["filter"] == search.best_
    for row in rows:
        assert row["complexity"] == row["filter"].nodes > 0 and row["nanoseconds_per_pixel"] > 0
        assert row["equation"] in row["filter"].formulas()
        assert np.isfinite(row["loss"]) and row["rel_mse"] > 0
    assert r"\begin" in search.latex() and r"\begin" in search.latex(0)
    clean = search.predict(**given)
    assert np.array_equal(clean, tamis.denoise(**given, filter=search.best_))
    with pytest.raises(TypeError, match="pace: there is no such parameter"):
        tamis.Search(pace=1)
    with pytest.raises(ValueError, match="preset: there is no `slow`"):
        tamis.Search("slow")
    with pytest.raises(ValueError, match="population"):
        tamis.Search(population=1).fit(SCENES[0].parent)


def pixels(png, channels):
    """The pixels of a PNG file of 8 bits per channel."""
    width, height = struct.unpack(">II", png[16:24])
    data, at = b"", 8
    while at < len(png):
        (length,) = struct.unpack(">I", png[at : at + 4])
        if png[at + 4 : at + 8] == b"IDAT":
            data += png[at + 8 : at + 8 + length]
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(data), np.uint8).reshape(height, 1 + channels * width).astype(int)
    # With a row above and a pixel on the left, of nothing.
    done = np.zeros((height + 1, width + 1, channels), int)
    for y, (kind, *row) in enumerate(rows):
        for x, left_over in enumerate(np.reshape(row, (width, channels))):
            left, above, corner = done[y + 1, x], done[y, x + 1], done[y, x]
            guess = left + above - corner
            near = [abs(guess - one) for one in (left, above, corner)]
            paeth = np.choose(np.argmin(near, axis=0), (left, above, corner))
            done[y + 1, x + 1] = (left_over + (0, left, above, (left + above) // 2, paeth)[kind]) % 256
    return done[1:, 1:]


def test_pictures_are_shown(tmp_path, frame):
    flat = np.full((4, 6, 3), 0.25, np.float32)
    picture = tamis.show(flat, exposure=1)
    assert repr(picture) == "<tamis.Picture: 6 x 4 pixels>"
    assert (pixels(picture._repr_png_(), 3) == 188).all()
    assert tamis.show(flat[..., 0], exposure=1).png == picture.png
    rgba = np.dstack([flat * 0.5, np.full((4, 6), 0.5, np.float32)])
    assert (pixels(tamis.show(rgba, 1).png, 4) == [188, 188, 188, 128]).all()
    picture.save(tmp_path / "picture.png")
    assert (tmp_path / "picture.png").read_bytes() == picture.png
    assert tamis.show(SCENES[0]).png == tamis.show(frame["color"]).png
    with pytest.raises(ValueError, match="exposure: it is 65"):
        tamis.show(flat, 65)
    with pytest.raises(FileNotFoundError):
        tamis.show(tmp_path / "none.exr")
