import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.geometry.p3p import solve_p3p


def triples(count: int, seed: int, spread: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (S, 3, 3), rays (S, 3, 3) and poses (S, 3, 4): anywhere in front, within ``spread`` of the optical axis."""
    generator = np.random.default_rng(seed)
    R = np.stack([cv2.Rodrigues(vector)[0] for vector in generator.normal(0, 1, (count, 3))])
    t = generator.normal(0, 2, (count, 3))
    seen = generator.uniform([-spread, -spread, 1], [spread, spread, 9], (count, 3, 3))
    seen[..., :2] *= seen[..., 2:]
    points = np.einsum("sji,skj->ski", R, seen - t[:, None])
    return points, seen / seen[..., 2:], np.concatenate([R, t[:, :, None]], 2)


def seen_by(poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (P, 3, 3) in the cameras' frames."""
    return np.einsum("pij,pkj->pki", poses[:, :, :3], points) + poses[:, None, :, 3]


@given(st.integers(0, 10_000), st.sampled_from([0.05, 0.3, 1.0]))
@settings(max_examples=20, deadline=None)
def test_the_true_pose_is_among_the_solutions(seed, spread):
    points, rays, truth = triples(50, seed, spread)
    poses, triple = solve_p3p(points, rays)
    error = np.full(50, np.inf)
    np.minimum.at(error, triple, np.abs(poses - truth[triple]).max((1, 2)))
    assert (error < 1e-6).sum() >= 49  # three points almost on a line, or a view along a singularity, lose digits
    assert (error < 1e-2).all()


@given(st.integers(0, 10_000))
@settings(max_examples=10, deadline=None)
def test_every_solution_is_a_rigid_motion_that_fits(seed):
    points, rays, _ = triples(50, seed)
    poses, triple = solve_p3p(points, rays)
    R = poses[:, :, :3]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.eye(3)[None].repeat(len(R), 0), atol=1e-10)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=1e-10)
    seen = seen_by(poses, points[triple])
    assert (seen[..., 2] > 0).all()
    np.testing.assert_allclose(seen / seen[..., 2:], rays[triple], atol=1e-7)
    assert np.bincount(triple).max() <= 4


@pytest.mark.parametrize("spread", [0.3, 1.0])
def test_the_solutions_are_those_of_opencv(spread):
    points, rays, _ = triples(200, 7, spread)
    poses, triple = solve_p3p(points, rays)
    compared = 0
    for s in range(200):
        _, rotations, translations = cv2.solveP3P(
            points[s], rays[s, :, :2].copy(), np.eye(3), None, flags=cv2.SOLVEPNP_AP3P
        )
        reference = [np.column_stack([cv2.Rodrigues(r)[0], t]) for r, t in zip(rotations, translations, strict=True)]
        seen = [seen_by(pose[None], points[s : s + 1])[0] for pose in reference]
        fits = [(p[:, 2] > 0).all() and np.abs(p / p[:, 2:] - rays[s]).max() < 1e-7 for p in seen]
        reference = [pose for pose, fit in zip(reference, fits, strict=True) if fit]
        own = poses[triple == s]
        for pose in reference:
            assert min(np.abs(other - pose).max() for other in own) < 1e-4
        for pose in own:
            assert min(np.abs(other - pose).max() for other in reference) < 1e-4
        compared += len(reference)
    assert compared > 250


def test_the_length_of_rays_and_the_unit_do_not_matter():
    points, rays, truth = triples(30, 3)
    poses, triple = solve_p3p(points, rays)
    scaled, again = solve_p3p(1000 * points, 7 * rays)
    np.testing.assert_array_equal(triple, again)
    np.testing.assert_allclose(scaled[:, :, 3], 1000 * poses[:, :, 3], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(scaled[:, :, :3], poses[:, :, :3], atol=1e-7)
    assert np.isfinite(truth).all()


def test_degenerate_triples_have_no_pose():
    points, rays, _ = triples(5, 0)
    points[1, 2] = (points[1, 0] + points[1, 1]) / 2  # on a line
    points[2, 1] = points[2, 0]  # twice the same
    points[3] = 0
    rays[4] = rays[4, :1]  # all on one ray
    with np.errstate(all="raise", under="ignore"):
        _, triple = solve_p3p(points, rays)
    assert set(triple) == {0}


def test_rays_that_no_triangle_fits():
    # the two outer points are nearer to each other than to the middle one, but their rays are farther apart
    points = np.array([[[0, 0, 0], [10, 0, 0], [0.1, 0.1, 0]]])
    rays = np.array([[[-5, 0, 1], [0, 0, 1], [5, 0.1, 1]]])
    poses, triple = solve_p3p(points, rays)
    seen = seen_by(poses, points[triple])
    assert len(poses) == 0 or np.abs(seen / seen[..., 2:] - rays[triple]).max() < 1e-6


def test_no_triples():
    poses, triple = solve_p3p(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)))
    assert poses.shape == (0, 3, 4)
    assert triple.shape == (0,)
