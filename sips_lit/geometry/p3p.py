"""P3P: the poses of a camera that sees three known points, for many triples at once.

With the distances s_1, s_2, s_3 from the camera as unknowns the law of cosines gives three quadratic equations. Two
differences of them are homogeneous: two conics, whose common points are the ratios of the distances. A degenerate conic
of their pencil, found by a cubic, is a pair of lines, and each line meets the conics in two points (Grunert 1841; as a
pair of conics in Persson and Nordberg, "Lambda Twist", ECCV 2018; the lines of a degenerate conic as in Richter-Gebert,
"Perspectives on Projective Geometry", 2011, section 11.3).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import FloatArray

Doubles = NDArray[np.float64]
_TINY: Final = 1e-12
_POLISH: Final = 3
_FITS: Final = 1e-8  # relative to the squared distances: what fits worse is no solution
_FIRST: Final = [0, 0, 1]  # the pairs of points, in the order of all pairwise quantities below
_SECOND: Final = [1, 2, 2]
# Inside, the many triples are the last axis: numpy then works on long rows, several times faster than on many short ones.


@np.errstate(divide="ignore", invalid="ignore", over="ignore")  # what is not finite in the end is left out
def solve_p3p(points: FloatArray, rays: FloatArray) -> tuple[Doubles, NDArray[np.int64]]:
    """Every pose (P, 3, 4) ``[R | t]`` that moves three points (S, 3, 3) of a triple onto its three rays (S, 3, 3).

    ``points[s, i]`` is a point in the world and ``rays[s, i]`` its direction from the camera, of any length. The second
    answer (P,) tells of which triple each pose is: up to four each, none for degenerate triples (points on one line or
    twice the same, rays that all coincide).
    """
    X, f = (np.ascontiguousarray(np.asarray(a, np.float64).transpose(1, 2, 0)) for a in (points, rays))
    f /= np.sqrt((f * f).sum(1))[:, None]
    sides = ((X[_FIRST] - X[_SECOND]) ** 2).sum(1)
    cosines = (f[_FIRST] * f[_SECOND]).sum(1)
    normal = _cross(X[1] - X[0], X[2] - X[0])
    regular = np.flatnonzero(((normal**2).sum(0) > _TINY * sides.max(0) ** 2) & (sides.min(0) > 0))
    X, f, sides, cosines = X[..., regular], f[..., regular], sides[:, regular], cosines[:, regular]
    # the unit of length does not matter to the directions: numbers near one are kinder
    unit = np.sqrt(sides.mean(0))
    squares = sides / unit**2
    distances, triple = _distances(squares, cosines)
    distances = _polished(distances, squares[:, triple], cosines[:, triple])
    fits = (np.abs(_misfit(distances, squares[:, triple], cosines[:, triple])) < _FITS * (distances**2).max(0)).all(0)
    poses = _poses(X[..., triple], f[..., triple] * (distances * unit[triple])[:, None])
    good = fits & (distances > 0).all(0) & np.isfinite(poses).all((0, 1))
    return np.ascontiguousarray(poses.transpose(2, 0, 1)[good]), regular[triple[good]]


def _distances(squares: Doubles, cosines: Doubles) -> tuple[Doubles, NDArray[np.int64]]:
    """Distances (3, P) of the points from the camera and the triple of each (P,), from squared sides and cosines (3, S)."""
    M = _cosine_forms(cosines)
    # s' M_ij s = squared side ij: eliminate the constants
    conic0 = M[0] * squares[2] - M[2] * squares[0]
    conic1 = M[1] * squares[2] - M[2] * squares[1]
    swap = np.abs(_determinant(conic0)) > np.abs(_determinant(conic1))
    A = np.where(swap, conic1, conic0)
    B = np.where(swap, conic0, conic1)  # the larger determinant: the cubic's leading coefficient
    factor = _real_root(A, B)
    lines, real = _lines(A + factor * B)
    # on its own lines the degenerate conic says nothing; any other of the pencil will do
    other = np.where(np.abs(factor) < 1, B, A)
    found, triples = [], []
    for line in lines:
        directions, meets = _meet(line, other)
        for direction in directions:
            triple = np.flatnonzero(real & meets)
            found.append(direction[:, triple])
            triples.append(triple)
    triple, chosen = np.concatenate(triples), np.concatenate(found, 1)
    form = _form(chosen, M.sum(0)[..., triple], chosen)
    scale = np.sqrt(squares.sum(0)[triple] / form) * np.where(chosen.sum(0) < 0, -1, 1)
    distances = chosen * scale
    ahead = np.isfinite(distances).all(0) & (distances > 0).all(0)
    return distances[:, ahead], triple[ahead]


def _cosine_forms(cosines: Doubles) -> Doubles:
    """(3, 3, 3, S): for each pair of points the quadratic form of the distances that equals their squared side."""
    M = np.zeros((3, 3, 3, cosines.shape[1]))
    for at, (i, j) in enumerate(zip(_FIRST, _SECOND, strict=True)):
        M[at, i, i] = M[at, j, j] = 1
        M[at, i, j] = M[at, j, i] = -cosines[at]
    return M


def _real_root(A: Doubles, B: Doubles) -> Doubles:
    """A real x (S,) with det(A + x B) = 0, of symmetric (3, 3, S)."""
    lead = _determinant(B)
    b = (_adjugate(B) * A).sum((0, 1)) / lead
    c = (_adjugate(A) * B).sum((0, 1)) / lead
    d = _determinant(A) / lead
    # y^3 + 3 p y + 2 q = 0 with x = y - b / 3
    p, q = (c - b * b / 3) / 3, (2 * b * b * b / 27 - b * c / 3 + d) / 2
    discriminant = q * q + p * p * p
    # one real root: the sum of two of equal sign; three: the largest of those
    one = np.cbrt(-q - np.copysign(np.sqrt(np.maximum(discriminant, 0)), q))
    radius = np.sqrt(np.maximum(-p, 0))
    angle = np.arccos(np.clip(-q / np.maximum(-p * radius, 1e-300), -1, 1)) / 3
    three = 2 * radius * np.cos(np.where(q <= 0, angle, angle + 2 * np.pi / 3))
    x = np.where(discriminant > 0, one - p / np.where(one == 0, np.inf, one), three) - b / 3
    for _ in range(2):
        slope = (3 * x + 2 * b) * x + c
        x = x - np.where(np.abs(slope) > _TINY, (((x + b) * x + c) * x + d) / slope, 0)
    return np.where(np.isfinite(x), x, 0)


def _lines(conic: Doubles) -> tuple[tuple[Doubles, Doubles], NDArray[np.bool_]]:
    """The two lines (3, S) that make up each degenerate conic (3, 3, S), and whether they are real (S,)."""
    each = np.arange(conic.shape[2])
    adjugate = _adjugate(conic)
    diagonal = -np.stack([adjugate[0, 0], adjugate[1, 1], adjugate[2, 2]])
    column = diagonal.argmax(0)
    square = diagonal[column, each]
    meeting = np.where(square > 0, adjugate[:, column, each] / np.sqrt(square), 0)
    rank_one = conic + _cross_matrix(meeting)  # of the lines l and m: 2 l m'
    row, column = np.divmod(np.abs(rank_one).reshape(9, -1).argmax(0), 3)
    return (rank_one[row, :, each].T, rank_one[:, column, each]), square > 0


def _meet(line: Doubles, conic: Doubles) -> tuple[tuple[Doubles, Doubles], NDArray[np.bool_]]:
    """The two points (3, S) where lines (3, S) meet conics (3, 3, S), and whether they are real (S,)."""
    line = line / np.maximum(np.sqrt((line * line).sum(0)), 1e-300)
    u = _cross(line, np.eye(3)[:, np.abs(line).argmin(0)])
    u /= np.maximum(np.sqrt((u * u).sum(0)), 1e-300)
    v = _cross(line, u)
    a, b, c = _form(u, conic, u), _form(u, conic, v), _form(v, conic, v)
    discriminant = b * b - a * c
    root = -(b + np.copysign(np.sqrt(np.maximum(discriminant, 0)), b))
    # homogeneous, so that neither solution can be at infinity
    return (root * u + a * v, c * u + root * v), discriminant >= -_TINY * (b * b + np.abs(a * c))


def _polished(distances: Doubles, squares: Doubles, cosines: Doubles) -> Doubles:
    """Newton's steps (3, P) on the three laws of cosines: the closed form loses digits near its singularities."""
    s = distances
    for _ in range(_POLISH):
        i, j = s[_FIRST], s[_SECOND]
        r0, r1, r2 = _misfit(s, squares, cosines) / 2
        a, b, e = i - cosines * j  # half the derivatives: rows [a c 0], [b 0 d], [0 e g]
        c, d, g = j - cosines * i
        change = np.stack(
            [
                c * (d * r2 - r1 * g) - r0 * d * e,
                a * (g * r1 - d * r2) - b * g * r0,
                e * (b * r0 - a * r1) - b * c * r2,
            ]
        ) / (-a * d * e - b * c * g)
        s = s - np.where(np.abs(change) < 0.5 * s, change, 0)
    return s


def _misfit(distances: Doubles, squares: Doubles, cosines: Doubles) -> Doubles:
    """By how much the squared sides (3, P) differ from those that distances (3, P) from the camera give."""
    i, j = distances[_FIRST], distances[_SECOND]
    return i * i + j * j - 2 * cosines * i * j - squares


def _poses(X: Doubles, Y: Doubles) -> Doubles:
    """[R | t] (3, 4, P) that moves triangles X (3 points, 3, P) onto congruent triangles Y (3 points, 3, P), exactly."""
    frame_x, frame_y = _frame(X), _frame(Y)
    R = [[(frame_y[:, i] * frame_x[:, j]).sum(0) for j in range(3)] for i in range(3)]
    centre_x, centre_y = X.mean(0), Y.mean(0)
    rows = [[*R[i], centre_y[i] - sum(R[i][j] * centre_x[j] for j in range(3))] for i in range(3)]
    return np.stack([np.stack(row) for row in rows])


def _frame(triangle: Doubles) -> Doubles:
    """Axes (3 axes, 3, P) fixed to triangles (3 points, 3, P)."""
    x, z = triangle[1] - triangle[0], _cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    x, z = x / np.sqrt((x * x).sum(0)), z / np.sqrt((z * z).sum(0))
    return np.stack([x, _cross(z, x), z])


def _cross(a: Doubles, b: Doubles) -> Doubles:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _form(u: Doubles, M: Doubles, v: Doubles) -> Doubles:
    """u' M v (S,) of vectors (3, S) and matrices (3, 3, S)."""
    return np.asarray((u * (M * v).sum(1)).sum(0), np.float64)


def _determinant(M: Doubles) -> Doubles:
    return np.asarray((M[0] * _cross(M[1], M[2])).sum(0), np.float64)


def _adjugate(M: Doubles) -> Doubles:
    """Of symmetric matrices (3, 3, S)."""
    return np.stack([_cross(M[1], M[2]), _cross(M[2], M[0]), _cross(M[0], M[1])])


def _cross_matrix(v: Doubles) -> Doubles:
    zero = np.zeros_like(v[0])
    return np.stack([np.stack([zero, -v[2], v[1]]), np.stack([v[2], zero, -v[0]]), np.stack([-v[1], v[0], zero])])
