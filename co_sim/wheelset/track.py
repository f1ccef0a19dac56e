"""The lateral offset of the track: synthesised from a spectrum or measured, as an input of the wheelset.

A synthesised track is a sum of harmonics with normally distributed amplitudes over one period `P`::

    y_t(x) = sum_k a_k cos(W_k x) + b_k sin(W_k x),   W_k = 2 pi k / P,   var a_k = var b_k = S(W_k) 2 pi / P

which is an inverse FFT. Three lengths fix it:

* Shortest wavelength 0.5 m. Beyond it the ERRI spectra, falling with W^-4, hold 2e-6 of the variance.
* Grid spacing an eighth of a metre, four points to the shortest wavelength: a cubic spline through them
  keeps 98.6 % of the amplitude there and all of it where the wheelset responds (metres).
* Period: the length asked for and ten times 1/Omega_r more. The covariance of such a sum is the wanted one
  repeated with `P`, so between any two points of the part in use it is wrong by exp(-10) of the variance
  at most. The harmonic at W = 0, a constant with half the variance of its neighbours, stands for all waves
  longer than twice the period; without it that part of the variance would be missing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NoReturn

import numpy as np
from scipy.fft import next_fast_len
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

from co_sim.compiled_component import CompiledComponent
from co_sim.component import Port
from co_sim.errors import InputError

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    from estimator.track_spectrum import TrackSpectrum

__all__ = ["SHORTEST_WAVELENGTH", "TrackInput", "TrackProfile", "read_track_csv", "synthesise"]

#: Shortest wavelength of a synthesised track, m.
SHORTEST_WAVELENGTH = 0.5
_POINTS_PER_WAVELENGTH = 4
_CORRELATION_LENGTHS = 10.0
#: A run may end on the last point of the track in spite of rounding.
_END_TOLERANCE = 1e-9

_INTERPOLANTS = {"spline": CubicSpline, "monotone": PchipInterpolator}


@dataclass(frozen=True, slots=True, eq=False)
class TrackProfile:
    """Lateral offset of the track centre line over the distance along it.

    Parameters
    ----------
    distance : shape (n,), n >= 4, strictly increasing, m.
    offset : shape (n,), positive in the direction of the wheelset's `y`, m.
    shape : ``"spline"`` is the cubic spline, right for a band-limited track on a dense grid.
        ``"monotone"`` is the piecewise cubic of Fritsch and Carlson: between two points it stays
        between their values, so that a kink or a gap in measured data makes no wave that was not measured.
    name : what error messages call the track.

    Attributes
    ----------
    curve : the interpolant, a piecewise cubic in the distance.

    Raises
    ------
    InputError
        If the arrays are not as described or hold values that are not finite.
    """

    distance: NDArray[np.float64]
    offset: NDArray[np.float64]
    shape: Literal["spline", "monotone"] = "spline"
    name: str = "track"
    curve: PPoly = field(init=False, repr=False)

    def __post_init__(self) -> None:
        distance = np.array(self.distance, dtype=np.float64)
        offset = np.array(self.offset, dtype=np.float64)
        _check_points(self.name, distance, offset)
        for values in (distance, offset):
            values.flags.writeable = False
        object.__setattr__(self, "distance", distance)
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "curve", _INTERPOLANTS[self.shape](distance, offset))

    @property
    def length(self) -> float:
        """Distance from the first to the last point, m."""
        return float(self.distance[-1] - self.distance[0])

    def offset_at(self, distance: ArrayLike) -> NDArray[np.float64]:
        """Return the offset (m) at `distance` (m, any shape), which must lie on the track."""
        x = np.asarray(distance, dtype=np.float64)
        on_track = (x >= self.distance[0]) & (x <= self.distance[-1])
        if not on_track.all():
            raise InputError(
                self.name,
                got=f"a distance of {x[~on_track].flat[0]:.9g} m",
                expected=f"{self.distance[0]:.9g} to {self.distance[-1]:.9g} m",
                remedy="stay on the track",
            )
        return np.asarray(self.curve(x))

    def require(self, length: float) -> None:
        """Raise `InputError` unless a run of `length` (m) fits on the track."""
        if not length <= self.length * (1.0 + _END_TOLERANCE):
            raise InputError(
                self.name,
                got=f"{self.length:.9g} m of track",
                expected=f"at least the {length:.9g} m of the run",
                remedy="shorten the run, lower the speed or give a longer track",
            )


def _check_points(name: str, distance: NDArray[np.float64], offset: NDArray[np.float64]) -> None:
    if distance.ndim != 1 or distance.shape != offset.shape or distance.size < 4:
        raise InputError(
            name,
            got=f"{distance.size} distances and {offset.size} offsets",
            expected="one offset for each distance and at least 4 points",
            remedy="give two columns of the same length, in m",
        )
    if not (np.isfinite(distance).all() and np.isfinite(offset).all()):
        raise InputError(
            name,
            got="a value that is not finite",
            expected="finite distances and offsets in m",
            remedy="remove the points without a measurement",
        )
    increasing = np.diff(distance) > 0.0
    if not increasing.all():
        i = int(np.argmin(increasing))
        _refuse_order(f"{name}, point {i + 2}", distance[i], distance[i + 1])


def _refuse_order(where: str, before: float, distance: float) -> NoReturn:
    raise InputError(
        where,
        got=f"a distance of {distance:.12g} m after {before:.12g} m",
        expected="strictly increasing distances",
        remedy="sort the points and remove doubled ones",
    )


def synthesise(spectrum: TrackSpectrum, length: float, rng: np.random.Generator) -> TrackProfile:
    """Draw a Gaussian random track from a one-sided spectrum.

    Parameters
    ----------
    spectrum : density of the offset over the path frequency.
    length : the track covers at least 0 to `length`, m. Another length draws another track.
    rng : source of the amplitudes.

    Returns
    -------
    TrackProfile
        A track with zero mean over the ensemble and the spectrum's density up to the
        path frequency ``2 pi / SHORTEST_WAVELENGTH``; see the module's text for the choice of grid.

    Raises
    ------
    InputError
        If `length` is not finite and positive.
    """
    if not (math.isfinite(length) and length > 0.0):
        raise InputError(
            "track length",
            got=f"{length:g} m",
            expected="a finite length > 0",
            remedy="use speed times duration",
        )
    dx = SHORTEST_WAVELENGTH / _POINTS_PER_WAVELENGTH
    n = next_fast_len(math.ceil((length + _CORRELATION_LENGTHS / spectrum.Omega_r) / dx), real=True)
    dW = 2.0 * math.pi / (n * dx)
    W = dW * np.arange(n // _POINTS_PER_WAVELENGTH + 1)

    a, b = np.sqrt(spectrum.density(W) * dW) * rng.standard_normal((2, W.size))
    harmonics = 0.5 * (a - 1j * b)
    harmonics[0] *= math.sqrt(2.0)
    offset: NDArray[np.float64] = np.fft.irfft(harmonics, n, norm="forward")

    points = max(math.ceil(length / dx) + 1, 4)
    return TrackProfile(dx * np.arange(points, dtype=np.float64), offset[:points], name="synthesised track")


def read_track_csv(path: str | os.PathLike[str]) -> TrackProfile:
    """Read a measured track: two columns, distance (m) and lateral offset (m), separated by a comma.

    A first line without numbers is taken for a header and blank lines are skipped. The profile is
    ``"monotone"`` and bears the file's name.

    Raises
    ------
    InputError
        If the file cannot be read or its content is not such a table; the line is named.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            path.name,
            got=getattr(error, "strerror", "bytes that are not text"),
            expected="a readable CSV file in UTF-8",
            remedy="check the path and the format of the file",
        ) from error
    table = [(number, line) for number, line in enumerate(lines, start=1) if line.strip()]
    if table and not any(map(_is_number, table[0][1].split(","))):
        del table[0]
    rows: list[tuple[float, float]] = []
    for number, line in table:
        where = f"{path.name}, line {number}"
        row = _read_row(where, line)
        if rows and row[0] <= rows[-1][0]:
            _refuse_order(where, rows[-1][0], row[0])
        rows.append(row)
    distance, offset = np.array(rows).reshape(-1, 2).T
    return TrackProfile(distance, offset, shape="monotone", name=path.name)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _read_row(where: str, line: str) -> tuple[float, float]:
    cells = line.split(",")
    if len(cells) != 2:
        raise InputError(
            where,
            got="one column" if len(cells) == 1 else f"{len(cells)} columns",
            expected="two columns, distance and lateral offset in m",
            remedy="separate the columns by one comma and write decimals with a point",
        )
    for cell in cells:
        if not (_is_number(cell) and math.isfinite(float(cell))):
            raise InputError(
                where,
                got=repr(cell.strip()),
                expected="a finite number",
                remedy="write decimals with a point and remove points without a measurement",
            )
    return float(cells[0]), float(cells[1])


class TrackInput(CompiledComponent):
    """The track under a wheelset that starts at the first point of `profile`.

    Input ``speed`` (m/s); outputs ``lateral_offset`` (m) and ``distance`` (m, from the first point).

    The offset counts from the track's first point and is faded in over the first `ramp` metres with the
    polynomial of fifth degree that has no jump in value, slope or curvature. A constant offset is only a
    choice of origin, whereas fading it in would be a bend of its own, steeper than the track's. Behind the
    start (a wheelset that rolls back, or one that begins further back) the track is straight.

    Parameters
    ----------
    profile : the track; `TrackProfile.require` tells before a run whether it is long enough.
    speed : value of the input when it is not connected, m/s; ``None`` requires a connection.
    ramp : length over which the offset is faded in, m; 0 switches the fade off.
    behind : how far before the first point the wheelset starts, m: the distance at which it follows another
        one, whose track it meets that much later.

    Raises
    ------
    InputError
        If `ramp` or `behind` is negative or not finite.
    """

    def __init__(
        self, profile: TrackProfile, *, speed: float | None = None, ramp: float = 5.0, behind: float = 0.0
    ) -> None:
        from co_sim.wheelset.steps import track_exchange, track_step

        for name, length, remedy in (
            ("ramp", ramp, "5 m suits most runs"),
            ("behind", behind, "count it backwards from the first point"),
        ):
            if not (math.isfinite(length) and length >= 0.0):
                raise InputError(
                    f"track {name}", got=f"{length:g} m", expected="a finite length >= 0", remedy=remedy
                )
        super().__init__(
            track_step,
            exchange=track_exchange,
            inputs=[Port("speed", "m/s", speed, "forward speed")],
            outputs=[
                Port("lateral_offset", "m", description="lateral offset of the track under the wheelset"),
                Port("distance", "m", description="distance from the first point of the track"),
            ],
            state=(0.0 - behind, 0.0, 0.0),
            prepare=self._pieces,
            feedthrough={},
        )
        self.profile = profile
        self._ramp = ramp

    def failure(self, status: int) -> Exception:
        """Return the error that the track ends before the step does, or that the speed is not a number."""
        from co_sim.wheelset.steps import TRACK_ENDED

        if status != TRACK_ENDED:
            return super().failure(status)
        return ValueError(
            f"{self.profile.name}: got a distance of {self._x[0]:.9g} m,"
            f" expected at most {self.profile.length:.9g} m;"
            " shorten the run, lower the speed or give a longer track"
        )

    def _pieces(self, h: float, parameters: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the ramp and the cubics of the track, from its first point, as `track_step` takes them."""
        curve = self.profile.curve
        left = curve.x[:-1] - curve.x[0]
        coefficients = curve.c.copy()
        coefficients[-1] -= self.profile.offset[0]
        end = self.profile.length * (1.0 + _END_TOLERANCE)
        return np.concatenate([[self._ramp, end, len(left)], left, coefficients.ravel()])
