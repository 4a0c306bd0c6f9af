#!/usr/bin/env python3
"""Makes bundle adjustment problems with known size as BAL files, the same for a seed every time.

usage: scenes.py window OUT --cameras 20 --landmarks 2000 --track 6
       scenes.py street OUT --cameras 500 --laps 2 --landmarks-per-camera 100 --track 5

window  Keyframes of a handheld camera that moves through one room: what local bundle adjustment
        sees. Its intrinsics are known, so solve it with --fix-intrinsics.
street  A car drives round a block `laps` times and looks ahead at facades on both sides. The block
        grows with the cameras, so that what one camera sees does not depend on their number; a
        landmark is tracked once a lap, which closes loops all along the block.

--track is the mean number of observations a landmark in one pass by it. The start is what odometry
and triangulation would leave: pose errors that wander along the path, landmarks placed by the first
camera that saw them, with an error along their ray.
Needs: numpy
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

import bal

# BAL counts pixels from the middle of the image.
HALF_WIDTH_PX, HALF_HEIGHT_PX = 400.0, 300.0
INTRINSICS = np.array([620.0, -0.04, 0.006])  # focal in px, k1, k2
SHORTEST_TRACK = 3
# Landmarks that are looked up at a time, to bound the memory.
CHUNK = 20_000


@dataclass
class Walk:
    """The true cameras: centers (n, 3) in the world, world_from_camera (n, 3, 3)."""

    centers: np.ndarray
    rotations: np.ndarray

    def look(self, cameras: np.ndarray, points: np.ndarray) -> np.ndarray:
        """`points` in the axes of `cameras`, both of the same leading shape."""
        return np.einsum("...ji,...j->...i", self.rotations[cameras], points - self.centers[cameras])


def looking(forward: np.ndarray) -> np.ndarray:
    """world_from_camera (n, 3, 3) that looks along `forward` (n, 3), level; columns right, up, back."""
    back = -forward / np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(back, right), back], axis=2)


def exponential(w: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3) of axis-angles (n, 3)."""
    columns = [bal.rotate(w, np.broadcast_to(axis, w.shape)) for axis in np.eye(3)]
    return np.stack(columns, axis=2)


def logarithm(r: np.ndarray) -> np.ndarray:
    """Axis-angles (n, 3) of rotation matrices (n, 3, 3), by way of unit quaternions."""
    # Four times the outer product of the quaternion (x, y, z, w) with itself: the row with the
    # largest diagonal gives it without cancellation.
    xx, yy, zz = r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]
    product = np.empty((len(r), 4, 4))
    product[:, 0, 0], product[:, 1, 1], product[:, 2, 2] = 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz
    product[:, 3, 3] = 1 + xx + yy + zz
    for i, j in ((0, 1), (0, 2), (1, 2)):
        product[:, i, j] = product[:, j, i] = r[:, i, j] + r[:, j, i]
    for i, (j, k) in enumerate(((2, 1), (0, 2), (1, 0))):
        product[:, i, 3] = product[:, 3, i] = r[:, j, k] - r[:, k, j]
    rows = np.arange(len(r))
    q = product[rows, np.argmax(product[:, range(4), range(4)], axis=1)]
    q *= np.where(q[:, 3:] < 0.0, -1.0, 1.0) / np.linalg.norm(q, axis=1, keepdims=True)
    sine = np.linalg.norm(q[:, :3], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[:, 3:])
    return q[:, :3] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)


def wander(rng: np.random.Generator, count: int, sigma: np.ndarray, memory: int) -> np.ndarray:
    """An error (count, len(sigma)) that wanders along the path and stays of size `sigma`."""
    keep = np.exp(-1.0 / memory)
    steps = rng.normal(size=(count, len(sigma))) * np.sqrt(1.0 - keep**2)
    steps[0] /= np.sqrt(1.0 - keep**2)
    for k in range(1, count):
        steps[k] += keep * steps[k - 1]
    return steps * sigma


def tracks(rng: np.random.Generator, seen: np.ndarray, mean: float) -> np.ndarray:
    """Keeps one run of cameras a row of `seen` (landmarks, cameras in order): a frontend's track.

    A run's length is uniform with the given mean; it starts anywhere among the cameras that see the
    landmark. Rows that end up shorter than SHORTEST_TRACK are emptied.
    """
    longest = max(SHORTEST_TRACK, round(2 * mean) - SHORTEST_TRACK)
    length = rng.integers(SHORTEST_TRACK, longest, size=len(seen), endpoint=True)
    total = seen.sum(axis=1)
    first = np.floor(rng.random(len(seen)) * np.maximum(total - length + 1, 1))
    order = np.cumsum(seen, axis=1) - 1
    kept = seen & (order >= first[:, None]) & (order < (first + length)[:, None])
    kept[kept.sum(axis=1) < SHORTEST_TRACK] = False
    return kept


def visible(in_camera: np.ndarray, nearest: float, farthest: float) -> np.ndarray:
    """Whether points in camera axes are in the image and at a depth that a frontend would take."""
    depth = -in_camera[..., 2]
    ahead = (depth > nearest) & (depth < farthest)
    plane = np.abs(in_camera[..., :2]) / np.where(ahead, depth, 1.0)[..., None]
    limit = np.array([HALF_WIDTH_PX, HALF_HEIGHT_PX]) / INTRINSICS[0]
    return ahead & np.all(plane < limit, axis=-1)


def window(rng: np.random.Generator, cameras: int, landmarks: int, track: float) -> tuple:
    """Walk, landmarks, observations (camera, landmark) of a room of 7 by 5 by 3 m."""
    room = np.array([7.0, 5.0, 3.0])
    # 12 cm a keyframe, 3 m at most, along one long side, swaying; the far wall stays in view.
    sway = np.arange(cameras)
    along = min(0.12, 3.0 / cameras) * sway
    centers = np.stack([2.0 + along, 1.1 + 0.15 * np.sin(0.9 * sway), 1.5 + 0.1 * np.sin(1.7 * sway)], axis=1)
    turn = 0.5 - 0.25 * along + 0.05 * np.sin(1.3 * sway)
    tilt = 0.04 * np.sin(0.7 * sway)
    walk = Walk(centers, looking(np.stack([np.sin(turn), np.cos(turn), tilt], axis=1)))
    points, seen = np.empty((0, 3)), np.empty((0, cameras), bool)
    while len(points) < landmarks:
        # On the far wall, the two side walls, the floor, or on furniture before the far wall.
        place = rng.random((CHUNK, 3))
        which = rng.choice(5, size=CHUNK, p=[0.4, 0.15, 0.15, 0.1, 0.2])
        place[which == 0, 1] = 1.0
        place[which == 1, 0], place[which == 2, 0] = 0.0, 1.0
        place[which == 3, 2] = 0.0
        place[which == 4] *= [1.0, 0.25, 0.5]
        place[which == 4] += [0.0, 0.7, 0.0]
        more = place * room
        camera = np.broadcast_to(np.arange(cameras), (CHUNK, cameras))
        in_camera = walk.look(camera, np.broadcast_to(more[:, None], (CHUNK, cameras, 3)))
        kept = tracks(rng, visible(in_camera, 0.4, 8.0), track)
        used = kept.any(axis=1)
        points, seen = np.concatenate([points, more[used]]), np.concatenate([seen, kept[used]])
    landmark_of, camera_of = np.nonzero(seen[:landmarks])
    return walk, points[:landmarks], camera_of, landmark_of


class Block:
    """The car's way: a square with rounded corners, by arc length, turning left."""

    CORNER_M = 6.0

    def __init__(self, length: float) -> None:
        corner = 0.5 * np.pi * self.CORNER_M
        self.side = max(length / 4.0 - corner, 1.0)
        self.length = 4.0 * (self.side + corner)

    def at(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position and heading (n, 2) after `s` meters; the block's middle is the origin."""
        piece, rest = np.divmod(np.mod(s, self.length), self.length / 4.0)
        angle = np.maximum(rest - self.side, 0.0) / self.CORNER_M
        x = np.minimum(rest, self.side) - 0.5 * self.side + self.CORNER_M * np.sin(angle)
        y = -0.5 * self.side - self.CORNER_M * np.cos(angle)
        turn = 0.5 * np.pi * piece
        position = np.column_stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y])
        return position, np.column_stack([np.cos(angle + turn), np.sin(angle + turn)])


def left_of(heading: np.ndarray) -> np.ndarray:
    """The unit vectors a quarter turn to the left, (n, 2)."""
    return np.column_stack([-heading[:, 1], heading[:, 0]])


def street(rng: np.random.Generator, cameras: int, laps: int, per_camera: int, track: float) -> tuple:
    """Walk, landmarks, observations (camera, landmark): a keyframe a meter, `laps` times round."""
    nearest_m, farthest_m = 5.0, 35.0
    a_lap = cameras // laps
    block = Block(float(a_lap))
    step_m = block.length / a_lap
    # Keyframes of different laps are not at the same places.
    driven = np.arange(cameras) + 0.3 * (np.arange(cameras) // a_lap)
    position, heading = block.at(driven * step_m)
    position += 0.3 * np.sin(0.05 * np.arange(cameras))[:, None] * left_of(heading)
    centers = np.column_stack([position, np.full(cameras, 1.6)])
    walk = Walk(centers, looking(np.column_stack([heading, np.zeros(cameras)])))

    landmarks = a_lap * per_camera
    s = np.sort(rng.random(landmarks)) * block.length
    position, heading = block.at(s)
    # Facades 6 to 10 m to either side, up to 9 m high.
    aside = rng.choice([-1.0, 1.0], size=landmarks) * rng.uniform(6.0, 10.0, size=landmarks)
    points = np.column_stack([position + aside[:, None] * left_of(heading), 9.0 * rng.random(landmarks)])
    # The cameras that may see a landmark in a pass are those up to `farthest_m` before it; the first
    # pass may begin before the first keyframe, the last one ends with the last.
    reach = np.arange(-int(np.ceil(farthest_m / step_m)) - 2, 1)
    pairs = []
    for begin in range(0, landmarks, CHUNK):
        chunk = slice(begin, begin + CHUNK)
        here = np.floor(s[chunk] / step_m).astype(int)
        for lap in range(laps + 1):
            camera = here[:, None] + lap * a_lap + reach
            exists = (camera >= 0) & (camera < cameras)
            camera = np.where(exists, camera, 0)
            in_camera = walk.look(camera, np.broadcast_to(points[chunk, None], (*camera.shape, 3)))
            seen = exists & visible(in_camera, nearest_m, farthest_m)
            landmark, column = np.nonzero(tracks(rng, seen, track))
            pairs.append(np.column_stack([landmark + begin, camera[landmark, column]]))
    pairs = np.concatenate(pairs)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    used, landmark_of = np.unique(pairs[:, 0], return_inverse=True)
    return walk, points[used], pairs[:, 1], landmark_of


def problem(rng: np.random.Generator, walk: Walk, points: np.ndarray, camera_of: np.ndarray,
            landmark_of: np.ndarray, noise_px: float, pose_sigma: np.ndarray, memory: int) -> bal.Bal:
    """The BAL problem with noisy pixels and a start that is off."""
    count = len(walk.centers)
    in_camera = walk.look(camera_of, points[landmark_of])
    intrinsics = np.broadcast_to(INTRINSICS, (count, 3))
    pixels = bal.project(intrinsics[camera_of], in_camera) + rng.normal(scale=noise_px, size=(len(camera_of), 2))

    error = wander(rng, count, pose_sigma, memory)
    rotations = np.einsum("nij,njk->nik", walk.rotations, exponential(error[:, 3:]))
    centers = walk.centers + error[:, :3]
    # A landmark is put on its ray from the first camera that saw it, at a depth 3 % off.
    _, first = np.unique(landmark_of, return_index=True)
    by = camera_of[first]
    ray = in_camera[first] * np.exp(0.03 * rng.normal(size=(len(points), 1)))
    start = np.einsum("nij,nj->ni", rotations[by], ray) + centers[by]

    camera_from_world = rotations.transpose(0, 2, 1)
    translation = -np.einsum("nij,nj->ni", camera_from_world, centers)
    cameras = np.column_stack([logarithm(camera_from_world), translation, intrinsics])
    return bal.Bal(cameras, start, camera_of, landmark_of, pixels)


def make_window(cameras: int, landmarks: int, track: float, noise_px: float, seed: int) -> bal.Bal:
    """A window whose poses start 2 cm and 0.5 degrees off."""
    rng = np.random.default_rng(seed)
    sigma = np.array([0.02] * 3 + [np.radians(0.5)] * 3)
    return problem(rng, *window(rng, cameras, landmarks, track), noise_px, sigma, memory=5)


def make_street(cameras: int, laps: int, per_camera: int, track: float, noise_px: float, seed: int) -> bal.Bal:
    """A street whose poses start 20 cm and 0.3 degrees off, correlated over 50 keyframes."""
    rng = np.random.default_rng(seed)
    sigma = np.array([0.2] * 3 + [np.radians(0.3)] * 3)
    return problem(rng, *street(rng, cameras, laps, per_camera, track), noise_px, sigma, memory=50)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=["window", "street"])
    parser.add_argument("out")
    parser.add_argument("--cameras", type=int, default=20)
    parser.add_argument("--landmarks", type=int, default=2000, help="of a window")
    parser.add_argument("--landmarks-per-camera", type=int, default=100, help="of a street, per camera of one lap")
    parser.add_argument("--laps", type=int, default=2, help="of a street")
    parser.add_argument("--track", type=float, default=6.0, help="mean observations a landmark in one pass")
    parser.add_argument("--noise-px", type=float, default=0.8)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    least = 45 * options.laps if options.kind == "street" else SHORTEST_TRACK
    if options.cameras < least or options.track < SHORTEST_TRACK:
        parser.error(f"needs at least {least} cameras and tracks of {SHORTEST_TRACK}")
    if options.kind == "window":
        made = make_window(options.cameras, options.landmarks, options.track, options.noise_px, options.seed)
    else:
        made = make_street(options.cameras, options.laps, options.landmarks_per_camera, options.track,
                           options.noise_px, options.seed)
    bal.write(options.out, made)
    print(f"{options.out}: {len(made.cameras)} cameras, {len(made.points)} points, {len(made.pixels)} observations, "
          f"{len(made.pixels) / len(made.points):.2f} a point, cost {made.cost():.6e}, "
          f"{made.behind_camera()} behind their camera")


if __name__ == "__main__":
    main()
