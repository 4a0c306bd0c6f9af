"""Writes room-openmvg.json: a scene as OpenMVG's sfm_data.json, one camera of each model that covis reads.

Members are nested as the serialization library cereal nests them: a type has its name only where it occurs
first, and two models have the members of their base in `value0`. One view has no pose, one point is seen by
that view too, and there is a control point. The camera of a spherical panorama is used by no placed view.
Observations have 0.3 px of noise; poses and points are moved away from the truth. Only numpy is needed.
"""

import json
from pathlib import Path

import numpy as np

FIRST = 1 << 31


def project(model: str, data: dict, in_camera: np.ndarray) -> np.ndarray:
    """OpenMVG's projection, pixels: the plane, the distortion of the model, then focal length and center."""
    x, y = in_camera[:2] / in_camera[2]
    r2 = x * x + y * y
    k1 = k2 = k3 = t1 = t2 = 0.0
    if model == "pinhole_radial_k1":
        (k1,) = data["disto_k1"]
    if model == "pinhole_radial_k3":
        k1, k2, k3 = data["disto_k3"]
    if model == "pinhole_brown_t2":
        k1, k2, k3, t1, t2 = data["disto_t2"]
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    if model == "fisheye":
        r = np.sqrt(r2)
        theta = np.arctan(r)
        a, b, c, d = data["fisheye"]
        radial = (theta + a * theta**3 + b * theta**5 + c * theta**7 + d * theta**9) / r
    plane = np.array(
        [
            x * radial + t2 * (r2 + 2 * x * x) + 2 * t1 * x * y,
            y * radial + t1 * (r2 + 2 * y * y) + 2 * t2 * x * y,
        ]
    )
    base = data.get("value0", data)
    return base["focal_length"] * plane + base["principal_point"]


def turned(angles: np.ndarray) -> np.ndarray:
    """The rotation by angles about x, then y, then z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def main() -> None:
    rng = np.random.default_rng(7)
    base = {"width": 640, "height": 480, "focal_length": 512.5, "principal_point": [321.25, 238.5]}
    types = [
        ("pinhole", {**base}),
        ("pinhole_radial_k1", {**base, "disto_k1": [-0.05]}),
        ("pinhole_radial_k3", {**base, "disto_k3": [-0.06, 0.02, -0.003]}),
        ("pinhole_brown_t2", {"value0": base, "disto_t2": [-0.05, 0.01, 0.002, 0.001, -0.0015]}),
        ("fisheye", {"value0": base, "fisheye": [0.01, -0.004, 0.002, -0.0005]}),
        ("pinhole", {**base, "focal_length": 498.75}),
        ("spherical", {"value0": {"width": 2048, "height": 1024}}),
    ]
    pointer = iter(range(1, 100))
    views, intrinsics, extrinsics, number_of = [], [], [], {}
    for key in range(len(types)):
        # Every second image is in a folder, so that the order of the names is not that of the keys.
        view = {
            "local_path": "left/" if key % 2 else "",
            "filename": f"image{key}.jpg",
            "width": 640,
            "height": 480,
            "id_view": key,
            "id_intrinsic": key,
            "id_pose": key,
        }
        wrapped = {"ptr_wrapper": {"id": FIRST + next(pointer), "data": view}}
        views.append({"key": key, "value": {"polymorphic_id": 1 << 30, **wrapped}})
    for key, (model, data) in enumerate(types):
        is_first = model not in number_of
        number = number_of.setdefault(model, len(number_of) + 1)
        value = {"polymorphic_id": number}
        if is_first:
            value = {"polymorphic_id": number + FIRST, "polymorphic_name": model}
        value["ptr_wrapper"] = {"id": FIRST + next(pointer), "data": data}
        intrinsics.append({"key": key, "value": value})
    poses = []
    for key in range(6):
        center = np.array([0.5 * key - 1.2, 0.3 * np.sin(key), 0.1 * key])
        rotation = turned(np.array([0.05, 0.08 * (key - 2.5), 0.1 * key - 0.2]))
        poses.append((rotation, center))
        near = turned(rng.normal(0, 0.004, 3)) @ rotation
        value = {"rotation": near.tolist(), "center": (center + rng.normal(0, 0.01, 3)).tolist()}
        extrinsics.append({"key": key, "value": value})
    structure = []
    for key in range(30):
        point = rng.uniform([-1.5, -1.2, 4], [1.5, 1.2, 7])
        observations = []
        for view, (rotation, center) in enumerate(poses):
            pixel = project(*types[view], rotation @ (point - center)) + rng.normal(0, 0.3, 2)
            observations.append({"key": view, "value": {"id_feat": key, "x": pixel.tolist()}})
        if key == 3:
            observations.append({"key": 6, "value": {"id_feat": 0, "x": [10.0, 20.0]}})
        value = {"X": (point + rng.normal(0, 0.02, 3)).tolist(), "observations": observations}
        structure.append({"key": 10 * key, "value": value})
    control = [{"key": 0, "value": {"X": [0.0, 0.0, 5.0], "observations": []}}]
    members = {
        "views": views,
        "intrinsics": intrinsics,
        "extrinsics": extrinsics,
        "structure": structure,
        "control_points": control,
    }
    head = ['"sfm_data_version": "0.3"', '"root_path": "/images"']
    lists = [
        f'"{name}": [\n' + ",\n".join(json.dumps(entry) for entry in entries) + "\n]"
        for name, entries in members.items()
    ]
    text = "{\n" + ",\n".join(head + lists) + "\n}\n"
    Path(__file__).with_name("room-openmvg.json").write_text(text)


if __name__ == "__main__":
    main()
