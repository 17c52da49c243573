"""Filters tuned on scenes, and searched for."""

from __future__ import annotations

import json
import operator
import os
from typing import Any, Optional, Sequence, Union

import numpy as np

from . import _tamis
from ._denoise import Denoiser, Progress, _watching
from ._errors import Error, InvalidTypeError, InvalidValueError
from ._filters import AnyFilter, found
from ._tamis import Filter

Path = Union[str, "os.PathLike[str]"]
Scenes = Union[Path, Sequence[Union[Path, "tuple[Path, Path]"]]]


def _places(scenes: Optional[Scenes]) -> list[Any]:
    if scenes is None:
        return []
    if isinstance(scenes, (str, os.PathLike)):
        return [os.fspath(scenes)]
    return [
        tuple(os.fspath(file) for file in place) if isinstance(place, (tuple, list)) else os.fspath(place)
        for place in scenes
    ]


def _settings(defaults: str, given: dict[str, Any], spelled: str = "_") -> str:
    """The defaults with what was given, each of the type that it has there."""
    settings = json.loads(defaults)
    for name, value in given.items():
        key = name.replace("_", spelled)
        if key not in settings:
            names = ", ".join(sorted(known.replace(spelled, "_") for known in settings))
            raise InvalidTypeError(f"{name}: there is no such parameter; there are {names}")
        wanted = type(settings[key])
        try:
            if wanted is int:
                value = operator.index(value)
            elif wanted is float:
                value = float(value)
            elif wanted is list and not isinstance(value, str):
                value = list(value)
            elif not isinstance(value, wanted):
                raise TypeError
        except (TypeError, ValueError):
            raise InvalidTypeError(f"{name}: it is {value!r}, but must be like {settings[key]!r}") from None
        if wanted is float and not np.isfinite(value):
            raise InvalidValueError(f"{name}: it is {value}, but must be a number")
        settings[key] = value
    return json.dumps(settings)


def tune(
    filter: AnyFilter,
    scenes: Scenes,
    validate: Optional[Scenes] = None,
    *,
    steps: int = 3000,
    seed: int = 1,
    backend: str = "jit",
    progress: Optional[Progress] = None,
    **parameters: Any,
) -> Filter:
    """A filter with its constants tuned on scenes by gradients, as ``tamis tune`` does.

    Ctrl-C ends it without a result; ``tamis tune`` keeps checkpoints.

    Parameters
    ----------
    filter
        A name, a filter file or a :class:`Filter` that has constants with names.
    scenes
        What to tune on: a folder with scenes in or below it (``reference.exr`` and ``4spp.exr``,
        ``16spp.exr`` and so on), several folders, or pairs ``(noisy, reference)`` of files.
    validate
        Scenes that are not tuned on: the constants that are best there are the result.
    steps
        Steps, 1 or more; the rates fall to nothing until the last.
    seed
        Names all random numbers: the same seed finds the same constants with any number of threads.
    backend
        ``"jit"`` or ``"interp"``.
    progress
        Called now and then as ``progress(step, steps)``.
    **parameters
        ``batch``, ``crop``, ``loss``, ``rate``, ``layer_rate``, ``decay``, ``drop``, ``stops``,
        ``clean``, ``interval``, ``patience``: see ``tamis tune --help``.
    """
    given = {"steps": steps, "seed": seed, **parameters}
    return _tamis.tune(
        found(filter),
        _places(scenes),
        _places(validate),
        settings=_settings(_tamis.settings(), given, "-"),
        backend=backend,
        progress=_watching(progress),
    )


class Search:
    """Breeds filters on scenes, as ``tamis evolve`` does: many stages, formulas and windows.

    The same seed finds the same filters with any number of threads, unless ``max_seconds`` ends it.

    Parameters
    ----------
    preset
        ``"quick"``: a few minutes. ``"programs"``: hours.
    initial
        The filter that it begins with; a small one if nothing is said.
    backend
        ``"jit"`` or ``"interp"``.
    max_seconds
        Ends the search after the generation in which the time is up.
    progress
        Called now and then as ``progress(judged, total)``, children of all generations.
    **parameters
        ``seed``, ``generations``, ``population``, ``children``, ``features``, ``max_nodes``,
        ``max_cost`` (nanoseconds per pixel)...: those of ``tamis evolve --help``.

    After :meth:`fit` there are ``best_``, the :class:`Filter` that did best, and ``equations_``:
    the filters of which none is better by error, predicted time and size together, the fastest
    first. That is a ``pandas.DataFrame`` if pandas is installed, else a list of dicts. Columns:
    ``complexity`` (nodes), ``nanoseconds_per_pixel`` (predicted, on one thread), ``loss`` (on the
    training scenes, lower is better), ``validation_loss``, ``rel_mse`` and ``trimmed_rel_mse`` (on
    the validation scenes; None without any), ``equation``, ``filter``.
    """

    def __init__(
        self,
        preset: str = "quick",
        *,
        initial: Optional[AnyFilter] = None,
        backend: str = "jit",
        max_seconds: Optional[float] = None,
        progress: Optional[Progress] = None,
        **parameters: Any,
    ) -> None:
        self._initial = None if initial is None else found(initial)
        if self._initial is not None:
            parameters["initial"] = self._initial.name
        self._settings = _settings(_tamis.preset(preset), parameters)
        self._backend = backend
        self._max_seconds = max_seconds
        self._progress = _watching(progress)
        self._denoiser: Optional[Denoiser] = None

    def fit(self, scenes: Scenes, validate: Optional[Scenes] = None) -> Search:
        """Searches. ``scenes`` and ``validate`` are as for :func:`tamis.tune`.

        Ctrl-C ends it without a result; ``tamis evolve`` keeps checkpoints.
        """
        best, front = _tamis.search(
            self._initial,
            _places(scenes),
            _places(validate),
            settings=self._settings,
            backend=self._backend,
            max_seconds=self._max_seconds,
            progress=self._progress,
        )
        self._best = best
        self.best_: Filter = best["filter"]
        try:
            import pandas  # type: ignore[import-untyped, unused-ignore]
        except ImportError:
            self.equations_: Any = front
        else:
            self.equations_ = pandas.DataFrame(front)
        self._front = front
        self._denoiser = None
        return self

    def _fitted(self) -> None:
        if not hasattr(self, "best_"):
            raise Error("the search has found nothing yet; call fit(scenes) first")

    def get_best(self) -> dict[str, Any]:
        """The row of the filter that did best, its constants tuned further."""
        self._fitted()
        return dict(self._best)

    def latex(self, index: Optional[int] = None) -> str:
        """The equations of the best filter, or of a row of ``equations_``, as LaTeX."""
        self._fitted()
        chosen: Filter = self.best_ if index is None else self._front[index]["filter"]
        return chosen.latex()

    def predict(self, color: Any, albedo: Any = None, **arrays: Any) -> np.ndarray:
        """Filters a frame with the best filter: arguments as for :func:`tamis.denoise`."""
        self._fitted()
        if self._denoiser is None:
            self._denoiser = Denoiser(self.best_, backend=self._backend)
        return self._denoiser.denoise(color, albedo, **arrays)

    def __repr__(self) -> str:
        found = f", found {self.best_!r}" if hasattr(self, "best_") else ""
        return f"<tamis.Search{found}>"
