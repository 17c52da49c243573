"""Denoising: arrays in memory, and files."""

from __future__ import annotations

import operator
import os
import sys
import warnings
from typing import Any, Callable, Mapping, Optional, Sequence, Union

import numpy as np

from . import _tamis
from ._errors import ImageWarning, InvalidTypeError, InvalidValueError
from ._filters import AnyFilter, found
from ._tamis import Filter

Path = Union[str, "os.PathLike[str]"]
Progress = Callable[[int, int], object]

# The most samples per pixel, and the most bytes, that the native half takes.
_MOST_SAMPLES = 2**32 - 1
_MOST_BYTES = 2**63 - 1
# The most threads that make sense.
_MOST_THREADS = 4096


def _count(name: str, count: Optional[int], most: int) -> Optional[int]:
    """A number of things, or None."""
    if count is None:
        return None
    try:
        whole = operator.index(count)
    except TypeError:
        raise InvalidTypeError(f"{name}: a {type(count).__name__} is no whole number") from None
    if not 1 <= whole <= most:
        raise InvalidValueError(f"{name}: it is {whole}, but must be from 1 to {most}")
    return whole


def _array(name: str, array: Any) -> np.ndarray:
    try:
        return np.asarray(array)
    except Exception as error:
        raise InvalidTypeError(f"{name}: a {type(array).__name__} is no array: {error}") from error


def _watching(progress: Optional[Progress]) -> Optional[Progress]:
    if progress is not None and not callable(progress):
        raise InvalidTypeError("progress: it must be a function that takes how much is done and of how much")
    return progress


def _callers_level() -> int:
    """How many calls above its caller the code of somebody else is, whose line warnings name."""
    level, frame = 0, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__package__") == __package__:
        level, frame = level + 1, frame.f_back
    return level


class Denoiser:
    """Filters frame after frame with code that is compiled once.

    Code is compiled for what is known of a frame: which features it has, and which of them are
    constant. It is kept for all frames that follow of which the same is known.

    Several threads may use one denoiser; each call takes all of its threads.

    Parameters
    ----------
    filter
        A name (:func:`tamis.filters` lists them), a filter file, a weight or a :class:`Filter`.
    backend
        ``"jit"``: machine code. ``"interp"``: the same bits, more slowly. ``"gpu"``: shaders, with
        another rounding. ``"auto"``: a GPU if there is one, else machine code. ``"exact"``: what
        filters mean, in double precision, in hundreds of times the time.
    gpu
        Which GPU: its index, or a part of its name; the best if nothing is said.
    precision
        ``"standard"``: within 1e-5 of the exact colour. ``"fast"``: within 1e-4, sooner.
    threads
        How many threads it has; as many as the computer's processor, shared with other denoisers,
        if nothing is said. No result depends on them.
    samples
        How many samples each pixel is the mean of, 1 or more, for filters that ask; what files say
        of themselves comes first if nothing is said here.
    strength
        How much of the result is taken, from 0 to 1; the rest is the noisy colour.
    repair
        What becomes of pixels that are NaN, infinite or beyond ±1e18: ``"median"`` replaces them by
        the median of the good ones around, ``"none"`` leaves them, ``"error"`` refuses the image.
    unfinished
        Whether files of renders that were not finished are read as far as they go.
    max_memory
        Bytes of memory for what is made of a file; larger files are filtered part by part, to the
        same bits. Arrays are always filtered whole.
    map
        What feeds features of files whose layers' names do not tell:
        ``{"albedo": "DiffuseFilter", "variance": "Var"}``.
    layers
        Further colour layers of files that are filtered by the colour's weights: ``["light_*"]``.
    alpha
        What becomes of the alpha of files: ``"keep"``, or ``"filter"`` by the colour's weights.
    view, layer
        This view, or this layer, of a file alone, if it has several that are pictures.
    """

    report: Optional[dict[str, Any]]
    """What there is to say of the latest call, or None: ``seconds`` in all,
    ``planning_seconds``, ``compilation_seconds``, ``filtering_seconds``; ``kept_pixels``, which
    kept what was to be averaged; ``warnings`` and ``notes``, texts on what was done to the image
    before; ``backend``. Of files also ``feeds``, which channels feed the filter, ``left_out``, what
    the result has no place for, and ``recompressed``, compressions that lost precision."""

    def __init__(
        self,
        filter: AnyFilter = "tamis",
        *,
        backend: str = "jit",
        gpu: Optional[str] = None,
        precision: str = "standard",
        threads: Optional[int] = None,
        samples: Optional[int] = None,
        strength: float = 1.0,
        repair: str = "median",
        unfinished: bool = False,
        max_memory: Optional[int] = None,
        map: Optional[Mapping[str, str]] = None,
        layers: Sequence[str] = (),
        alpha: str = "keep",
        view: Optional[str] = None,
        layer: Optional[str] = None,
    ) -> None:
        if isinstance(layers, str):
            layers = [layers]
        self._native = _tamis.Denoiser(
            found(filter),
            backend=backend,
            gpu=gpu,
            precision=precision,
            threads=_count("threads", threads, _MOST_THREADS),
            samples=_count("samples", samples, _MOST_SAMPLES),
            strength=strength,
            repair=repair,
            unfinished=unfinished,
            max_memory=_count("max_memory", max_memory, _MOST_BYTES),
            map=[f"{feature}={layer}" for feature, layer in (map or {}).items()],
            layers=list(layers),
            alpha=alpha,
            view=view,
            layer=layer,
        )
        self.report = None

    @property
    def filter(self) -> Filter:
        """What it filters with."""
        return self._native.filter

    @property
    def backend(self) -> str:
        """What runs the filter."""
        return self._native.backend

    def __repr__(self) -> str:
        return f"<tamis.Denoiser: {self.filter!r} on {self.backend}>"

    def denoise(
        self,
        color: Any,
        albedo: Any = None,
        normal: Any = None,
        depth: Any = None,
        position: Any = None,
        direct: Any = None,
        alpha: Any = None,
        color_variance: Any = None,
        albedo_variance: Any = None,
        normal_variance: Any = None,
        depth_variance: Any = None,
        position_variance: Any = None,
        direct_variance: Any = None,
        secondary_albedo: Any = None,
        secondary_albedo_variance: Any = None,
        *,
        samples: Optional[int] = None,
        out: Optional[np.ndarray] = None,
        progress: Optional[Progress] = None,
    ) -> np.ndarray:
        """Filters a frame in memory: see :func:`tamis.denoise`."""
        arrays = {
            "color": color,
            "albedo": albedo,
            "normal": normal,
            "depth": depth,
            "position": position,
            "direct": direct,
            "alpha": alpha,
            "color_variance": color_variance,
            "albedo_variance": albedo_variance,
            "normal_variance": normal_variance,
            "depth_variance": depth_variance,
            "position_variance": position_variance,
            "direct_variance": direct_variance,
            "secondary_albedo": secondary_albedo,
            "secondary_albedo_variance": secondary_albedo_variance,
        }
        given = [(name, _array(name, array)) for name, array in arrays.items() if array is not None]
        if color is None:
            raise InvalidTypeError("color: the frame has no colour; give it the noisy image")
        noisy = given[0][1]
        if out is None:
            kind = np.float16 if noisy.dtype == np.float16 else np.float32
            out = np.empty(noisy.shape, kind)
        elif not isinstance(out, np.ndarray):
            raise InvalidTypeError(f"out: a {type(out).__name__} cannot be written to; give a NumPy array")
        count = _count("samples", samples, _MOST_SAMPLES)
        report = self._native.denoise(given, out, samples=count, progress=_watching(progress))
        if noisy.shape[2] == 4 and out is not color:
            out[..., 3] = noisy[..., 3]
        self._keep(report, "")
        return out

    def denoise_file(
        self,
        input: Path,
        output: Path,
        *,
        albedo: Optional[Path] = None,
        normal: Optional[Path] = None,
        depth: Optional[Path] = None,
        aux: Sequence[Path] = (),
        exposure: float = 0.0,
        progress: Optional[Progress] = None,
    ) -> None:
        """Filters a file into another: see :func:`tamis.denoise_file`."""
        said = [(albedo, "albedo"), (normal, "normal"), (depth, "depth")]
        beside: list[tuple[str, Optional[str]]] = []
        beside += [(os.fspath(path), feature) for path, feature in said if path is not None]
        beside += [(os.fspath(path), None) for path in aux]
        report = self._native.denoise_file(
            os.fspath(input),
            os.fspath(output),
            beside=beside,
            exposure=exposure,
            progress=_watching(progress),
        )
        self._keep(report, f"{os.fspath(input)}: ")

    def _keep(self, report: dict[str, Any], of: str) -> None:
        self.report = report
        for text in report["warnings"]:
            warnings.warn(of + text, ImageWarning, stacklevel=_callers_level() + 1)


def denoise(
    color: Any,
    albedo: Any = None,
    normal: Any = None,
    depth: Any = None,
    position: Any = None,
    direct: Any = None,
    alpha: Any = None,
    color_variance: Any = None,
    albedo_variance: Any = None,
    normal_variance: Any = None,
    depth_variance: Any = None,
    position_variance: Any = None,
    direct_variance: Any = None,
    secondary_albedo: Any = None,
    secondary_albedo_variance: Any = None,
    *,
    filter: AnyFilter = "tamis",
    backend: str = "jit",
    precision: str = "standard",
    threads: Optional[int] = None,
    samples: Optional[int] = None,
    strength: float = 1.0,
    repair: str = "median",
    out: Optional[np.ndarray] = None,
    progress: Optional[Progress] = None,
) -> np.ndarray:
    """Filters a frame in memory.

    The result has the bits that ``tamis denoise`` writes for the same frame as a file. Whoever
    filters several frames keeps a :class:`Denoiser`, which compiles once. Arrays are read where
    they lie, at any strides, the negative ones of flipped images too. Other Python threads run
    meanwhile, and Ctrl-C ends it.

    Parameters
    ----------
    color
        The noisy image: (H, W, 3), linear light in any unit, premultiplied by the alpha if there
        is one. Of (H, W, 4) the fourth component is the alpha, and the result keeps it.
    albedo
        Albedo of what is seen, from 0 to 1: (H, W, 3).
    normal
        Shading normals of length 1, in the world or in the camera: (H, W, 3), from -1 to 1.
    depth
        Distance from the camera, in any unit: (H, W).
    position
        Place of the first hit in the world, in any unit: (H, W, 3).
    direct
        Direct light, in the unit of the colour: (H, W, 3).
    alpha
        How much of each pixel is covered, from 0 to 1: (H, W). Where it and the colour are zero,
        the result is.
    color_variance
        Variance of each pixel's mean (that of its samples, divided by their number), in the square
        of the colour's unit: (H, W, 3). It is estimated from the image if it is not given.
    albedo_variance, normal_variance, depth_variance, position_variance, direct_variance
        The same of the other features, the mean over their components: (H, W).
    secondary_albedo, secondary_albedo_variance
        The albedo that is seen through glossy or specular reflection, and its variance.
    filter, backend, precision, threads, samples, strength, repair
        As for :class:`Denoiser`.
    out
        Where the result goes: an array of the colour's shape, float32 or float16; ``color`` itself,
        say. A new one of the colour's type if nothing is said. What is beyond ±65504 is written to
        float16 as that.
    progress
        Called now and then as ``progress(done, total)``, rows in both, on the caller's thread. What
        it raises ends the work.

    Returns
    -------
    The filtered image, of the colour's shape: ``out``, if that was given.

    Raises
    ------
    ValueError
        If an array has a wrong shape, or an option a value that makes no sense.
    TypeError
        If an array's samples are neither float32 nor float16.
    tamis.Error
        For these and for everything else that goes wrong.
    """
    denoiser = Denoiser(
        filter,
        backend=backend,
        precision=precision,
        threads=threads,
        samples=samples,
        strength=strength,
        repair=repair,
    )
    return denoiser.denoise(
        color,
        albedo,
        normal,
        depth,
        position,
        direct,
        alpha,
        color_variance,
        albedo_variance,
        normal_variance,
        depth_variance,
        position_variance,
        direct_variance,
        secondary_albedo,
        secondary_albedo_variance,
        out=out,
        progress=progress,
    )


def denoise_file(
    input: Path,
    output: Path,
    *,
    albedo: Optional[Path] = None,
    normal: Optional[Path] = None,
    depth: Optional[Path] = None,
    aux: Sequence[Path] = (),
    exposure: float = 0.0,
    progress: Optional[Progress] = None,
    **options: Any,
) -> dict[str, Any]:
    """Filters a file into another, to the bytes that ``tamis denoise`` writes.

    Parameters
    ----------
    input
        The noisy image with its features: OpenEXR, PFM, TIFF or PNG.
    output
        Where the result goes: ``.exr`` (the input with its colour replaced), ``.png`` (tone-mapped)
        or ``.pfm`` (linear). It appears whole or not at all.
    albedo, normal, depth
        Files with these features in them.
    aux
        Other files with features, whose names or whose channels' names tell which.
    exposure
        Stops by which PNG results are made brighter, from -64 to 64.
    progress
        Called now and then as ``progress(done, total)``.
    **options
        Those of :class:`Denoiser`: ``filter``, ``backend``, ``map``, ``layers``, ``alpha``...

    Returns
    -------
    What there is to say: see :attr:`Denoiser.report`.
    """
    denoiser = Denoiser(**options)
    denoiser.denoise_file(
        input,
        output,
        albedo=albedo,
        normal=normal,
        depth=depth,
        aux=aux,
        exposure=exposure,
        progress=progress,
    )
    assert denoiser.report is not None
    return denoiser.report
