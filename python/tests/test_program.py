"""The same bits as the `tamis` program."""

import json

import numpy as np
import pytest

import tamis
from conftest import SCENES, run


def written(scene, path, *arguments):
    status, _, error = run("denoise", scene, "-o", path, *arguments)
    assert status == 0, error
    return path


def test_arrays_get_the_bits_of_the_programs_files(scene, tmp_path):
    frame = tamis.read(scene)
    clean = tamis.denoise(**frame)
    assert clean.dtype == np.float32 and clean.shape == frame["color"].shape
    assert not np.array_equal(clean, frame["color"])
    expected = tamis.read(written(scene, tmp_path / "program.pfm"))["color"]
    assert clean.tobytes() == expected.tobytes()
    # The scenes' own files hold halves.
    expected = tamis.read(written(scene, tmp_path / "program.exr"))["color"]
    halves = tamis.denoise(**frame, out=np.empty(clean.shape, np.float16))
    assert np.array_equal(halves, expected)


@pytest.mark.parametrize("ending", ["exr", "png", "pfm"])
def test_files_are_the_programs_files(scene, tmp_path, ending):
    expected = written(scene, tmp_path / f"program.{ending}")
    report = tamis.denoise_file(scene, tmp_path / f"package.{ending}")
    assert (tmp_path / f"package.{ending}").read_bytes() == expected.read_bytes()
    assert report["seconds"] > 0 and report["backend"] and "albedo" in report["feeds"][0]


def test_options_are_the_programs_options(tmp_path):
    scene = SCENES[1]
    arguments = ["--filter", "tamis-fast", "--precision", "fast", "--strength", "0.5", "--samples", "8"]
    expected = written(scene, tmp_path / "program.exr", *arguments)
    denoiser = tamis.Denoiser("tamis-fast", precision="fast", strength=0.5, samples=8)
    denoiser.denoise_file(scene, tmp_path / "package.exr")
    assert (tmp_path / "package.exr").read_bytes() == expected.read_bytes()
    expected = written(scene, tmp_path / "bright.png", "--exposure", "-1.5", "--map", "albedo=Albedo")
    tamis.denoise_file(scene, tmp_path / "package.png", exposure=-1.5, map={"albedo": "Albedo"})
    assert (tmp_path / "package.png").read_bytes() == expected.read_bytes()


@pytest.mark.parametrize("name", ["interp", "jit"])
def test_back_ends_agree(colors, name):
    given, expected = colors
    assert np.array_equal(tamis.denoise(**given, backend=name), expected)


def test_inspect_says_what_the_program_says(scene):
    status, text, error = run("inspect", "--json", scene)
    assert status == 0, error
    found = tamis.inspect(scene)
    assert found["size"] == (found["layers"][0]["width"], found["layers"][0]["height"])
    assert "color" not in found["absent"]
    expected = json.loads(text)
    assert {key: found[key] for key in expected} == {**expected, "file": found["file"]}


def test_compare_says_what_the_program_says(scene):
    reference = scene.with_name("reference.exr")
    status, text, error = run("compare", "--json", scene, reference)
    assert status == 0, error
    expected = json.loads(text)
    of_files = tamis.compare(scene, reference)
    assert {key: of_files[key] for key in expected} == expected
    of_arrays = tamis.compare(tamis.read(scene)["color"], tamis.read(reference)["color"])
    assert of_arrays == of_files
    clean = tamis.denoise(**tamis.read(scene))
    assert tamis.compare(clean, reference)["rel_mse"] < of_files["rel_mse"] / 4


def test_equal_images_are_infinitely_similar(frame):
    same = tamis.compare(frame["color"], frame["color"])
    assert same["psnr_db"] == float("inf") and same["mse"] == 0 and same["flip"] == 0


def test_filters_are_the_programs_filters():
    for name in ("tamis-formula", "bilateral"):
        status, text, error = run("filters", "show", name)
        assert status == 0, error
        assert text == f"{name}\n\n{tamis.Filter(name).formulas()}"
    assert "tamis" in tamis.filters()
    for language, export in [("latex", "latex"), ("python", "to_python"), ("c", "to_c")]:
        status, text, error = run("export", "tamis-formula", "--lang", language)
        assert status == 0, error
        assert text == getattr(tamis.Filter("tamis-formula"), export)()


def test_errors_have_the_programs_texts(tmp_path):
    def texts(error, *arguments):
        status, _, told = run("denoise", *arguments)
        assert status != 0
        assert str(error.value) in told, told
        assert isinstance(error.value, tamis.Error)

    missing = tmp_path / "missing.exr"
    with pytest.raises(FileNotFoundError) as error:
        tamis.denoise_file(missing, tmp_path / "out.exr")
    texts(error, missing, "-o", tmp_path / "out.exr")
    with pytest.raises(ValueError) as error:
        tamis.denoise_file(SCENES[0], tmp_path / "out.jpg")
    texts(error, SCENES[0], "-o", tmp_path / "out.jpg")
    with pytest.raises(ValueError) as error:
        tamis.denoise_file(SCENES[0], tmp_path / "out.exr", filter="bilatral")
    texts(error, SCENES[0], "-o", tmp_path / "out.exr", "--filter", "bilatral")
    damaged = tmp_path / "damaged.exr"
    damaged.write_bytes(SCENES[0].read_bytes()[:10000])
    with pytest.raises(tamis.Error) as error:
        tamis.denoise_file(damaged, tmp_path / "out.exr")
    texts(error, damaged, "-o", tmp_path / "out.exr")
    assert not (tmp_path / "out.exr").exists()
    copy = tmp_path / "copy.exr"
    copy.write_bytes(SCENES[0].read_bytes())
    with pytest.raises(ValueError) as error:
        tamis.denoise_file(copy, copy)
    texts(error, copy, "-o", copy)
