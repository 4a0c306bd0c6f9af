"""How well a map of one camera keeps its scale, where the scale of its odometry drifts.

A camera drives along a straight street, half a meter a keyframe, with pixels of 0.5 px and no depth. Its
odometry errs by 2.5 mm and 0.02° a keyframe, and its scale grows by --drift a keyframe. Errors are those of
positions after the best similarity.

    python3 benches/reference/monocular.py [--keyframes 200] [--drift 0.005] [--seed 1] [--metric]

prints the error of odometry and map, and how many times longer the last steps are than the first ones. With
--metric the server takes the odometry's lengths for measured ones. It starts the server that it asks.
"""

import argparse

import covis
import numpy as np
from covis import v1

STEP = 0.5
INTRINSICS = np.array([[500.0, 0, 640], [0, 500, 360], [0, 0, 1]])
IMAGE = (1280, 720)
CAMERA_FROM_STREET = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""The camera looks along the street, x, with z up there."""
VIEW = (5.0, 15.0)
"""How far ahead what it sees is, m."""


def small_rotation(angles: np.ndarray) -> np.ndarray:
    """A rotation by small angles, rad, to the second order."""
    x, y, z = angles
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / 2


def aligned_error(positions: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square of the errors after the best similarity (Umeyama 1991)."""
    a, b = positions - positions.mean(0), truth - truth.mean(0)
    left, singular, right = np.linalg.svd(b.T @ a)
    signs = np.array([1, 1, np.sign(np.linalg.det(left @ right))])
    scale = (singular * signs).sum() / (a**2).sum()
    errors = b - scale * a @ (left * signs @ right).T
    return float(np.sqrt((errors**2).sum(1).mean()))


def growth(positions: np.ndarray) -> float:
    """How many times longer the last steps are than the first."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return float(steps[-10:].mean() / steps[:10].mean())


def main() -> None:
    """Prints a row for odometry and one for the map."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keyframes", type=int, default=200)
    parser.add_argument("--drift", type=float, default=0.005, help="of the scale, a keyframe")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--metric", action="store_true", help="keep MapPolicy.metric_odometry true")
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    count = arguments.keyframes
    way, points = STEP * np.arange(count), 12 * count
    along = np.sort(rng.uniform(-5, way[-1] + 25, points))
    side = (2 * rng.integers(0, 2, points) - 1) * rng.uniform(3, 8, points)
    landmarks = np.stack([along, side, rng.uniform(-2, 3, points)], 1)
    truth = np.stack([way, 0 * way, 0 * way], 1)
    odometry = np.eye(4)
    odometry[:3, :3] = CAMERA_FROM_STREET.T
    tracked = []
    with covis.local() as client:
        policy = v1.MapPolicy(metric_odometry=arguments.metric)
        session = client.ingest("street", "camera", policy=policy)
        session.camera(0, *IMAGE, INTRINSICS)
        for k, position in enumerate(truth):
            if k > 0:
                step = np.eye(4)
                step[:3, :3] = small_rotation(rng.normal(0, np.radians(0.02), 3))
                step[:3, 3] = [0, 0, STEP] + rng.normal(0, 0.0025, 3)
                step[:3, 3] *= np.exp(arguments.drift * k)
                odometry = odometry @ step
            tracked.append(odometry[:3, 3])
            seen = np.arange(*np.searchsorted(along, way[k] + np.array(VIEW)))
            rays = (landmarks[seen] - position) @ CAMERA_FROM_STREET.T @ INTRINSICS.T
            pixels = rays[:, :2] / rays[:, 2:] + rng.normal(0, 0.5, (len(seen), 2))
            inside = ((pixels > 0) & (pixels < np.array(IMAGE) - 1)).all(1)
            session.keyframe(k, float(k), odometry, pixels[inside], seen[inside])
            session.wait_optimized()
        poses = client.watch("street").poses
    mapped = np.array([poses[k][:3, 3] for k in range(count)])
    print("", "error", "steps", sep="\t")
    for name, positions in [("odometry", np.array(tracked)), ("map", mapped)]:
        error, grown = aligned_error(positions, truth), growth(positions)
        print(name, f"{error:.3f} m", f"{grown:.3f}", sep="\t")


if __name__ == "__main__":
    main()
