"""How far the vertices of meshes lie from the true surface of a synthetic sequence.

usage: surface_error.py SEQUENCE_WITHOUT_NOISE MESH.ply... [--most 0.05]

The truth is the sequence's own: its exact depth images (covis synth rgbd --no-noise) at its true poses make a
cloud of points with planes through their neighbors in the image. A vertex counts by its distance from the
plane of the nearest point; one with no point within --most meters is not near any surface that was seen: it is
counted apart. The cloud's points that no vertex is near to are what a mesh lacks. Needs: pip install numpy scipy
"""
import argparse

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from render_mesh import read_ply

# Every so many frames and pixels.
FRAMES, PIXELS = 10, 2
# A plane through neighbors that lie apart by more than this share of the depth would cross an edge.
EDGE = 0.02


def rows(path):
    return [line.split() for line in open(path) if line.strip() and not line.startswith("#")]


def truth(folder, most_depth):
    camera = [float(word) for word in " ".join(" ".join(row) for row in rows(f"{folder}/camera.txt")).split()]
    fx, fy, cx, cy = camera[:4]
    poses = np.array([[float(word) for word in row[:8]] for row in rows(f"{folder}/groundtruth.txt")])
    points, normals = [], []
    for stamp, name in rows(f"{folder}/depth.txt")[::FRAMES]:
        pose = poses[np.abs(poses[:, 0] - float(stamp)).argmin()]
        depth = np.asarray(Image.open(f"{folder}/{name}")) / 5000.0
        v, u = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
        cloud = np.stack([(u - cx) / fx * depth, (v - cy) / fy * depth, depth], -1)
        across, down = cloud[2:, 1:-1] - cloud[:-2, 1:-1], cloud[1:-1, 2:] - cloud[1:-1, :-2]
        middle = cloud[1:-1, 1:-1]
        normal = np.cross(across, down)
        length = np.linalg.norm(normal, axis=-1)
        flat = np.maximum(np.abs(across[..., 2]), np.abs(down[..., 2])) < EDGE * middle[..., 2]
        seen = (middle[..., 2] > 0) & (middle[..., 2] < most_depth) & flat & (length > 0)
        seen[np.arange(seen.shape[0]) % PIXELS != 0, :] = False
        seen[:, np.arange(seen.shape[1]) % PIXELS != 0] = False
        turn = Rotation.from_quat(pose[4:8]).as_matrix()
        points.append(middle[seen] @ turn.T + pose[1:4])
        normals.append(normal[seen] / length[seen][:, None] @ turn.T)
    return np.concatenate(points), np.concatenate(normals)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("sequence")
    parser.add_argument("meshes", nargs="+")
    parser.add_argument("--most", type=float, default=0.05)
    parser.add_argument("--max-depth", type=float, default=4.0)
    args = parser.parse_args()
    points, normals = truth(args.sequence, args.max_depth)
    tree = cKDTree(points)
    print("| mesh | vertices | RMSE mm | median mm | 95 % mm | near no surface | of the surface, missing |")
    print("|---|---|---|---|---|---|---|")
    for path in args.meshes:
        vertices = read_ply(path)[0]
        away, nearest = tree.query(vertices, distance_upper_bound=args.most, workers=2)
        near = np.isfinite(away)
        error = np.abs(((vertices[near] - points[nearest[near]]) * normals[nearest[near]]).sum(1)) * 1e3
        lacking = ~np.isfinite(cKDTree(vertices).query(points[::10], distance_upper_bound=args.most, workers=2)[0])
        print(f"| {path} | {len(vertices)} | {np.sqrt((error**2).mean()):.2f} | {np.median(error):.2f} "
              f"| {np.percentile(error, 95):.2f} | {100 * (~near).mean():.2f} % | {100 * lacking.mean():.2f} % |", flush=True)


if __name__ == "__main__":
    main()
