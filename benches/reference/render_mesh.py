"""Draws a mesh of `covis fuse` or `covis run --mesh` as a picture: lit, colored, with its normals.

usage: render_mesh.py MESH.ply OUT.png [--from x,y,z --at x,y,z --up x,y,z] [--size WxH] [--field DEGREES] [--gray]

Without --from the mesh is seen from its own first camera: the origin, along z, y down. A triangle is
tested against each pixel of its bounding box, all triangles of one box size at once. Triangles seen
from behind are drawn dark, so that a surface with the wrong side out is noticed.
Needs: pip install numpy pillow
"""
import argparse

import numpy as np
from PIL import Image

TYPES = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
MOST_PIXELS = 64


def read_ply(path):
    data = open(path, "rb").read()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    vertex, counts, element = [], {}, None
    for line in data[:end].decode().splitlines():
        words = line.split()
        if words[0] == "element":
            element = words[1]
            counts[element] = int(words[2])
        elif words[0] == "property" and element == "vertex":
            vertex.append((words[2], TYPES[words[1]]))
    table = np.frombuffer(data, np.dtype(vertex), counts["vertex"], end)
    rows = np.frombuffer(data, np.dtype([("n", "u1"), ("i", "<i4", 3)]), counts["face"], end + table.nbytes)
    xyz = np.stack([table[name] for name in "xyz"], 1).astype(float)
    rgb = np.stack([table[name] for name in ("red", "green", "blue")], 1) / 255.0
    return xyz, rgb, rows["i"]


def look(eye, at, up):
    z = at - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def draw(xyz, rgb, faces, rotation, eye, size, field, gray):
    width, height = size
    focal = 0.5 * width / np.tan(np.radians(field) / 2)
    camera = (xyz - eye) @ rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        pixel = camera[:, :2] / camera[:, 2:] * focal + [width / 2, height / 2]
    faces = faces[(camera[faces, 2] > 0.05).all(1)]
    corners = pixel[faces]
    low, high = np.floor(corners.min(1)).astype(int), np.ceil(corners.max(1)).astype(int)
    seen = (high >= 0).all(1) & (low < [width, height]).all(1) & (high - low < MOST_PIXELS).all(1)
    faces, corners, low, high = faces[seen], corners[seen], low[seen], high[seen]

    a, b, c = (xyz[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    to_eye = eye - (a + b + c) / 3
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    facing = (normal * to_eye).sum(1)
    light = np.where(facing > 0, 0.35 + 0.65 * facing, 0.12)

    depth = np.full(width * height, np.inf)
    image = np.ones((width * height, 3))
    box = (high - low + 1).max(1)
    edge = lambda p, q, r: (q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0])
    area = edge(corners[:, 0], corners[:, 1], corners[:, 2])
    for pixels in np.unique(box):
        chosen = np.flatnonzero((box == pixels) & (np.abs(area) > 1e-12))
        for dv in range(pixels):
            for du in range(pixels):
                at = low[chosen] + [du, dv]
                p = corners[chosen]
                w = np.stack([edge(p[:, 1], p[:, 2], at), edge(p[:, 2], p[:, 0], at), edge(p[:, 0], p[:, 1], at)], 1)
                w /= area[chosen, None]
                inside = (w >= -1e-9).all(1) & (at >= 0).all(1) & (at < [width, height]).all(1)
                k, w, at = chosen[inside], w[inside], at[inside]
                z = 1 / (w / camera[faces[k], 2]).sum(1)
                where = at[:, 1] * width + at[:, 0]
                # Farthest first: of two on one pixel the nearer is written last.
                order = np.argsort(-z)
                k, w, z, where = k[order], w[order], z[order], where[order]
                nearer = z < depth[where]
                k, w, z, where = k[nearer], w[nearer], z[nearer], where[nearer]
                depth[where] = z
                color = 0.8 if gray else (rgb[faces[k]] * w[..., None]).sum(1)
                image[where] = color * light[k, None] * (1 if gray else 1.25)
    return (np.clip(image, 0, 1) * 255).astype(np.uint8).reshape(height, width, 3)


def main():
    numbers = lambda text: np.array([float(x) for x in text.split(",")])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("mesh")
    parser.add_argument("out")
    parser.add_argument("--from", dest="eye", type=numbers, default=np.zeros(3))
    parser.add_argument("--at", type=numbers)
    parser.add_argument("--up", type=numbers, default=np.array([0.0, -1.0, 0.0]))
    parser.add_argument("--size", default="960x720")
    parser.add_argument("--field", type=float, default=70.0)
    parser.add_argument("--gray", action="store_true")
    args = parser.parse_args()
    xyz, rgb, faces = read_ply(args.mesh)
    at = args.eye + [0.0, 0.0, 1.0] if args.at is None else args.at
    size = tuple(int(side) for side in args.size.split("x"))
    # Twice as fine and then halved, against jagged edges.
    fine = tuple(2 * side for side in size)
    image = draw(xyz, rgb, faces, look(args.eye, at, args.up), args.eye, fine, args.field, args.gray)
    Image.fromarray(image).resize(size, Image.Resampling.BOX).save(args.out)


if __name__ == "__main__":
    main()
