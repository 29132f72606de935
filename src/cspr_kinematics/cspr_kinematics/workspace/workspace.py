"""The wrench-feasible workspace on a grid of positions: its margin, volume and border."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_kinematics.arrays import (
    BoolArray,
    FloatArray,
    ReadOnlyArrays,
    checked,
    frozen,
)
from cspr_kinematics.errors import InvalidInputError

_SUBDIVISION = 5  # places along each axis of a cell that the border cuts
_CELLS_AT_ONCE = 20_000
_ARRAYS = ("x", "y", "z", "margin", "payload_min", "payload_max")


@dataclass(frozen=True, eq=False)
class Workspace(ReadOnlyArrays):
    """Margin and payloads of a task on a grid of positions; arrays are read-only.

    Attributes
    ----------
    x, y, z : numpy.ndarray, shape (nx,), (ny,), (nz,)
        Coordinates of the platform's origin in base, m.
    margin : numpy.ndarray, shape (nx, ny, nz)
        Margin of the task, N, as in `Feasibility`; the smallest of all orientations. -inf where a cable has
        no path or the cables are singular.
    payload_min, payload_max : numpy.ndarray, shape (nx, ny, nz)
        Smallest and largest payload that can be held in every orientation, kg; NaN where there is none.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    margin: FloatArray
    payload_min: FloatArray
    payload_max: FloatArray

    def __post_init__(self) -> None:
        shape = len(self.x), len(self.y), len(self.z)
        for name in _ARRAYS:
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if name in "xyz":
                if array.ndim != 1 or len(array) < 2 or not (np.diff(array) > 0.0).all():
                    raise InvalidInputError(name, array, "2 or more increasing coordinates are needed")
            elif array.shape != shape:
                raise InvalidInputError(name, array, f"shape {array.shape} where {shape} is needed")
            self._set(**{name: frozen(array)})

    @property
    def feasible(self) -> BoolArray:
        """Whether the task is possible, shape (nx, ny, nz)."""
        return np.asarray(self.margin >= 0.0)

    @cached_property
    def volume(self) -> float:
        """Volume in which the task is possible, m^3; the border is interpolated within the cells that it cuts."""
        sizes = np.einsum("i,j,k->ijk", np.diff(self.x), np.diff(self.y), np.diff(self.z))
        return float((self._shares * sizes).sum())

    def margin_at(self, position: ArrayLike) -> FloatArray:
        """Return the margin at positions (..., 3) in base, by trilinear interpolation, shape (...), N.

        Raises
        ------
        InvalidInputError
            If a value is not finite, has another shape, or lies outside the grid.
        """
        points = checked("position", position, 3)
        low = np.array([self.x[0], self.y[0], self.z[0]])
        high = np.array([self.x[-1], self.y[-1], self.z[-1]])
        if np.any(points < low) or np.any(points > high):
            raise InvalidInputError(
                "position", position, f"outside the grid, {low.tolist()} to {high.tolist()}"
            )
        from scipy.interpolate import RegularGridInterpolator  # here, because its import takes long

        margin = RegularGridInterpolator((self.x, self.y, self.z), self._finite_margin)(points)
        return np.asarray(margin).reshape(points.shape[:-1])

    def distance_to_boundary(self, position: ArrayLike) -> FloatArray:
        """Return how far positions (..., 3) are from the border of the workspace, shape (...), m.

        Positive inside and negative outside; -inf outside if there is no border at all. The border is where the
        interpolated margin passes through zero, seen along lines a quarter of the grid's spacing apart: close
        to it the result is too large by up to about a fifth of the spacing. For positions inside, the faces
        of the grid count as border: nothing is known beyond them.

        Raises
        ------
        InvalidInputError
            As in `margin_at`.
        """
        points = checked("position", position, 3)
        inside = self.margin_at(points) >= 0.0
        distance = np.full(points.shape[:-1], np.inf)
        if len(self._border):
            from scipy.spatial import cKDTree  # here, because its import takes long

            distance = np.asarray(cKDTree(self._border).query(points)[0])
        faces = [
            np.minimum(points[..., k] - axis[0], axis[-1] - points[..., k])
            for k, axis in enumerate((self.x, self.y, self.z))
        ]
        return np.asarray(np.where(inside, np.minimum(distance, np.min(faces, axis=0)), -distance))

    def save(self, path: str | Path) -> None:
        """Write the arrays to a compressed .npz file, under their names here."""
        with Path(path).open("wb") as file:
            np.savez_compressed(file, **{name: getattr(self, name) for name in _ARRAYS})

    @classmethod
    def load(cls, path: str | Path) -> Workspace:
        """Read what `save` wrote.

        Raises
        ------
        InvalidInputError
            If the file is not one that `save` wrote.
        """
        try:
            with np.load(path) as data:
                return cls(*(data[name] for name in _ARRAYS))
        except (OSError, KeyError, ValueError) as error:
            raise InvalidInputError("path", str(path), f"not the file of a workspace ({error})") from error

    @cached_property
    def _finite_margin(self) -> FloatArray:
        """The margin for interpolation: -inf is replaced by the negative of the largest absolute value."""
        finite = self.margin[np.isfinite(self.margin)]
        lowest = -max(1.0, float(np.abs(finite).max())) if finite.size else -1.0
        return np.maximum(self.margin, lowest)

    @cached_property
    def _shares(self) -> FloatArray:
        """Share of each cell in which the interpolated margin is not negative."""
        corners = self._corners
        shares = (corners.min(axis=(3, 4, 5)) >= 0.0).astype(np.float64)
        cells = self._cut_cells
        inside = np.empty(len(cells))
        for part in _parts(len(cells)):
            values = _in_cells(corners[tuple(cells[part].T)], (np.arange(_SUBDIVISION) + 0.5) / _SUBDIVISION)
            inside[part] = (values >= 0.0).mean(axis=(1, 2, 3))
        shares[tuple(cells.T)] = inside
        return np.asarray(shares)

    @cached_property
    def _border(self) -> FloatArray:
        """Points (n, 3) at which lines through the cut cells cross the border, m."""
        axes = self.x, self.y, self.z
        fractions = np.linspace(0.0, 1.0, _SUBDIVISION)
        points = [np.empty((0, 3))]
        for part in _parts(len(self._cut_cells)):
            cells = self._cut_cells[part]
            values = _in_cells(self._corners[tuple(cells.T)], fractions)
            for k in range(3):
                before = np.moveaxis(values, k + 1, -1)[..., :-1]
                after = np.moveaxis(values, k + 1, -1)[..., 1:]
                passing = np.nonzero((before >= 0.0) != (after >= 0.0))
                start, end = before[passing], after[passing]
                cell, *others, along = passing
                share = np.empty((len(cell), 3))
                share[:, k] = fractions[along] + start / (start - end) * fractions[1]
                share[:, [j for j in range(3) if j != k]] = fractions[np.stack(others, axis=-1)]
                corner = np.stack([axis[i] for axis, i in zip(axes, cells[cell].T, strict=True)], axis=-1)
                size = np.stack([np.diff(axis)[i] for axis, i in zip(axes, cells[cell].T, strict=True)], -1)
                points.append(corner + share * size)
        return np.asarray(np.concatenate(points))

    @cached_property
    def _corners(self) -> FloatArray:
        """Margin at the corners of each cell, shape (nx - 1, ny - 1, nz - 1, 2, 2, 2)."""
        return np.asarray(np.lib.stride_tricks.sliding_window_view(self._finite_margin, (2, 2, 2)))

    @cached_property
    def _cut_cells(self) -> NDArray[np.int64]:
        """Indices (n, 3) of the cells that the border cuts."""
        least, most = self._corners.min(axis=(3, 4, 5)), self._corners.max(axis=(3, 4, 5))
        return np.asarray(np.argwhere((least < 0.0) & (most >= 0.0)))


def _parts(count: int) -> list[slice]:
    """Ranges of cut cells that are treated together, to limit the memory used."""
    return [slice(first, first + _CELLS_AT_ONCE) for first in range(0, count, _CELLS_AT_ONCE)]


def _in_cells(corners: FloatArray, fractions: FloatArray) -> FloatArray:
    """Interpolate from corners (n, 2, 2, 2) to all places (n, f, f, f) with these fractions (f,)."""
    weights = np.stack((1.0 - fractions, fractions), axis=-1)
    return np.asarray(np.einsum("cijk,ui,vj,wk->cuvw", corners, weights, weights, weights, optimize=True))
