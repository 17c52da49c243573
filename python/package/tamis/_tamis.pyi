"""The native half: call the functions of ``tamis`` instead."""

import os
from typing import Any, Callable, Optional, Sequence, Union

import numpy as np

VERSION: str

_Path = Union[str, "os.PathLike[str]"]
_Progress = Optional[Callable[[int, int], object]]
_Image = Union[np.ndarray, str]
_Places = Sequence[Union[str, tuple[str, str]]]

class Filter:
    """A filter: what ``tamis.denoise`` computes, as formulas that can be read, kept and exported.

    ``Filter(text)`` takes a filter's name (``tamis.filters()`` lists them), a filter file, or a
    weight such as ``"exp(-distance2(normal, normal) / 0.1)"``. Filters do not change; they can be
    compared, pickled, and used as keys.
    """

    def __new__(cls, text: str) -> Filter: ...
    @staticmethod
    def read(path: _Path) -> Filter:
        """Reads a filter file."""
    @staticmethod
    def from_toml(text: str) -> Filter:
        """Reads the text of a filter file."""
    @property
    def name(self) -> str:
        """What people call it."""
    @property
    def nodes(self) -> int:
        """What a reader has to read: nodes of all formulas, and numbers of layers."""
    @property
    def stages(self) -> int:
        """How many stages it has: 1 for a single weight."""
    @property
    def features(self) -> list[str]:
        """The names of the features that it reads, the colour among them."""
    def formulas(self) -> str:
        """What it computes, stage by stage, as ``tamis filters show`` prints it."""
    def latex(self) -> str:
        """Its equations as LaTeX, for a document that loads amsmath: a page for a program."""
    def to_python(self) -> str:
        """It as a Python module of NumPy functions, which says what it means, and is slow."""
    def to_c(self) -> str:
        """It as C99, to the bits of ``tamis.denoise(backend="interp")``."""
    def to_toml(self) -> str:
        """It as the text of a filter file."""
    def save(self, path: _Path) -> None:
        """Writes it as a filter file, which ``tamis denoise --filter`` takes."""
    def __hash__(self) -> int: ...
    def __eq__(self, other: object) -> bool: ...

class Denoiser:
    def __new__(
        cls,
        filter: Filter,
        *,
        backend: str,
        gpu: Optional[str],
        precision: str,
        threads: Optional[int],
        samples: Optional[int],
        strength: float,
        repair: str,
        unfinished: bool,
        max_memory: Optional[int],
        map: list[str],
        layers: list[str],
        alpha: str,
        view: Optional[str],
        layer: Optional[str],
    ) -> Denoiser: ...
    @property
    def filter(self) -> Filter: ...
    @property
    def backend(self) -> str: ...
    def denoise(
        self,
        arrays: list[tuple[str, np.ndarray]],
        out: np.ndarray,
        *,
        samples: Optional[int],
        progress: _Progress,
    ) -> dict[str, Any]: ...
    def denoise_file(
        self,
        input: str,
        output: str,
        *,
        beside: list[tuple[str, Optional[str]]],
        exposure: float,
        progress: _Progress,
    ) -> dict[str, Any]: ...

def names() -> list[str]: ...
def inspect(path: str) -> str: ...
def read(path: str) -> dict[str, Any]: ...
def compare(image: _Image, reference: _Image) -> dict[str, Any]: ...
def png(image: _Image, exposure: float) -> bytes: ...
def settings() -> str: ...
def tune(
    filter: Filter,
    scenes: _Places,
    validate: _Places,
    *,
    settings: str,
    backend: str,
    progress: _Progress,
) -> Filter: ...
def preset(name: str) -> str: ...
def search(
    initial: Optional[Filter],
    scenes: _Places,
    validate: _Places,
    *,
    settings: str,
    backend: str,
    max_seconds: Optional[float],
    progress: _Progress,
) -> tuple[dict[str, Any], list[dict[str, Any]]]: ...
