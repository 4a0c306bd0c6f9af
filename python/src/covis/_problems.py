"""Problems that come with a call, and their answers: arrays on one side, messages on the other.

Lists of observations, points and edges are written by `_rows`, so that large problems cost no Python
loop a row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _items, _poses, _rows
from .noise import unpack_symmetric
from .v1 import (
    BundleProblem,
    Camera,
    ChordalCertificate,
    ClosureRobustness,
    Gauge,
    IterationSummary,
    LocalizeRequest,
    LocalizeResponse,
    Loss,
    LossKind,
    PoseGraphSe2,
    PoseGraphSe3,
    PoseGraphStart,
    RefinePoseRequest,
    RefinePoseResponse,
    RobustKernel,
    SolverOptions,
    SolveSummary,
    SwitchedOffEdge,
)

Array = _poses.Array


@dataclass(frozen=True, eq=False)
class BundleSolution:
    """What `solve_bundle` found."""

    world_from_camera: Array
    """N×4×4, in the order of the problem."""
    points: Array
    """M×3, world frame, m."""
    cameras: list[Camera]
    summary: SolveSummary
    """The certificate: termination, cost before and after, residuals."""
    iterations: list[IterationSummary] = field(default_factory=list)
    """Only when asked for."""


@dataclass(frozen=True, eq=False)
class PoseGraphSolution:
    """What `solve_pose_graph` found."""

    ids: _items.Ids
    world_from_vertex: Array
    """N×4×4, in the plane N×3×3, in the order of `ids`."""
    summary: SolveSummary
    """The certificate."""
    switched_off: list[SwitchedOffEdge]
    """Edges that were found false, by index."""
    certificate: ChordalCertificate | None
    """Only when asked for."""
    iterations: list[IterationSummary] = field(default_factory=list)
    """Only when asked for."""


@dataclass(frozen=True, eq=False)
class Localization:
    """Where a camera was found in a map."""

    world_from_camera: Array
    """4×4."""
    covariance: Array
    """6×6, of a right perturbation of the pose, translation first."""
    landmarks: dict[int, tuple[str, int]]
    """Landmark by index of the feature that shows it."""
    response: LocalizeResponse
    """All that the server answered."""


@dataclass(frozen=True, eq=False)
class RefinedPose:
    """What `refine_pose` found."""

    world_from_camera: Array
    """4×4."""
    summary: SolveSummary
    """The certificate: termination, cost before and after, residuals."""
    information: Array | None
    """6×6, of a right perturbation of the pose, translation first. Only when asked for."""


def loss(text: str | None) -> Loss | None:
    """A loss by its name and width, such as "huber:2"; `None` is the server's default."""
    if text is None:
        return None
    name, _, width = text.partition(":")
    kind: Any = choice(LossKind, "LOSS_KIND_", "loss", name)
    if (name == "trivial") == bool(width):
        raise ValueError(f"loss must have a width, such as huber:2, and trivial none; not {text!r}")
    return Loss(kind=kind, width=float(width)) if width else Loss(kind=kind)


def choice(enum: Any, prefix: str, name: str, value: str | None) -> int:
    """The number of an enum's value by its name in lower case, with dashes; 0 for `None`."""
    if value is None:
        return 0
    known = {key.removeprefix(prefix).lower().replace("_", "-"): enum.Value(key) for key in enum.keys()}
    known.pop("unspecified")
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(known)}, not {value!r}")
    return int(known[value])


def gauge(value: str | None) -> int:
    """A gauge by its name."""
    return choice(Gauge, "GAUGE_", "gauge", value)


def robustness(value: str | None) -> ClosureRobustness | None:
    """A kernel by its name."""
    if value is None:
        return None
    kernel = choice(RobustKernel, "ROBUST_KERNEL_", "robust", value)
    return ClosureRobustness(kernel=kernel)  # type: ignore[arg-type]


def start(value: str | None) -> int:
    """A start by its name."""
    return choice(PoseGraphStart, "POSE_GRAPH_START_", "start", value)


def options(max_iterations: int | None, time_limit_s: float | None) -> SolverOptions:
    """How a solve runs."""
    out = SolverOptions()
    if max_iterations is not None:
        out.max_iteration_count = max_iterations
    if time_limit_s is not None:
        out.deadline_ms = max(1, round(time_limit_s * 1000))
    return out


def bundle(
    cameras: Sequence[Camera],
    world_from_camera: npt.ArrayLike,
    points: npt.ArrayLike,
    pose_indices: npt.ArrayLike,
    point_indices: npt.ArrayLike,
    pixels: npt.ArrayLike,
    depths: npt.ArrayLike | None,
    sigmas: npt.ArrayLike | None,
    sigma_px: npt.ArrayLike | None,
    camera_indices: npt.ArrayLike | None,
    fixed_poses: npt.ArrayLike | None,
    fixed_points: npt.ArrayLike | None,
) -> BundleProblem:
    """A bundle adjustment problem."""
    poses = _poses.matrices("world_from_camera", world_from_camera)
    xyz = _poses.shaped("points", points, None, 3)
    of_pose = _items.ids("pose_indices", pose_indices)
    of_point = _items.ids("point_indices", point_indices)
    if not len(of_pose) == len(of_point) == len(np.asarray(pixels)):
        raise ValueError("pose_indices, point_indices and pixels must have one row an observation")
    problem = BundleProblem(cameras=cameras)
    which = np.zeros(len(poses), np.int64)
    if camera_indices is not None:
        which = _items.ids("camera_indices", camera_indices)
        if len(which) != len(poses):
            raise ValueError(f"camera_indices must be one a pose, {len(poses)}, not {len(which)}")
    columns = _rows.integers(1, which) + _rows.nested(2, _rigid(poses))
    columns += _rows.integers(3, _marks("fixed_poses", fixed_poses, len(poses)))
    raw = _rows.join(_rows.nested(2, columns))
    columns = _rows.nested(1, _rows.doubles(1, xyz))
    columns += _rows.integers(2, _marks("fixed_points", fixed_points, len(xyz)))
    raw += _rows.join(_rows.nested(3, columns))
    columns = _rows.integers(1, of_pose) + _rows.integers(2, of_point)
    columns += _items.measurements(pixels, depths, sigmas, sigma_px, 3)
    raw += _rows.join(_rows.nested(4, columns))
    problem.MergeFromString(raw)
    return problem


def bundle_solution(response: Any) -> BundleSolution:
    """The answer to a bundle."""
    problem = response.problem
    points = [(p.x, p.y, p.z) for p in (point.point_in_world for point in problem.points)]
    return BundleSolution(
        _poses.from_messages([pose.world_from_camera for pose in problem.poses]),
        np.array(points, np.float64).reshape(-1, 3),
        list(problem.cameras),
        response.summary,
        list(response.iterations),
    )


def graph(
    ids: npt.ArrayLike,
    world_from_vertex: npt.ArrayLike | None,
    edges: npt.ArrayLike,
    i_from_j: npt.ArrayLike,
    information: npt.ArrayLike,
    fixed: Sequence[int],
    trusted: npt.ArrayLike | None,
) -> PoseGraphSe3 | PoseGraphSe2:
    """A pose graph in space (4×4) or in the plane (3×3)."""
    vertices = _items.ids("ids", ids)
    measured = np.asarray(i_from_j, np.float64)
    size = measured.shape[-1] if measured.ndim == 3 else 4
    if size not in (3, 4):
        raise ValueError(f"i_from_j must be M×4×4 or M×3×3, not of shape {measured.shape}")
    measured = _poses.matrices("i_from_j", measured, size)
    pairs = np.asarray(edges)
    if pairs.shape != (len(measured), 2) or pairs.dtype.kind not in "iu":
        raise ValueError(f"edges must be {len(measured)}×2 ids, not {pairs.dtype} of {pairs.shape}")
    dimension = 6 if size == 4 else 3
    weights = np.asarray(information, np.float64)
    if weights.shape == (dimension, dimension):
        weights = np.broadcast_to(weights, (len(measured), dimension, dimension))
    weights = _poses.shaped("information", weights, len(measured), dimension, dimension)
    if not np.allclose(weights, weights.transpose(0, 2, 1), rtol=1e-9, atol=0.0, equal_nan=True):
        raise ValueError("information is not symmetric")
    rows, columns = np.triu_indices(dimension)
    transform = _rigid if size == 4 else _planar
    parts = _rows.integers(1, vertices)
    if world_from_vertex is not None:
        poses = _poses.matrices("world_from_vertex", world_from_vertex, size)
        if len(poses) != len(vertices):
            raise ValueError(f"world_from_vertex must be one an id, {len(vertices)}, not {len(poses)}")
        parts += _rows.nested(2, transform(poses))
    parts += _rows.integers(3, np.isin(vertices, np.asarray(fixed, np.int64)).astype(np.int64))
    raw = _rows.join(_rows.nested(1, parts))
    parts = _rows.integers(1, pairs[:, 0].astype(np.int64)) + _rows.integers(2, pairs[:, 1].astype(np.int64))
    parts += _rows.nested(3, transform(measured))
    parts += _rows.nested(4, _rows.packed_doubles(1, weights[:, rows, columns]))
    parts += _rows.integers(6, _marks("trusted", trusted, len(measured)))
    raw += _rows.join(_rows.nested(2, parts))
    return PoseGraphSe3.FromString(raw) if size == 4 else PoseGraphSe2.FromString(raw)


def graph_solution(response: Any) -> PoseGraphSolution:
    """The answer to a pose graph."""
    kind = response.WhichOneof("graph")
    vertices = getattr(response, kind).vertices
    transforms = [vertex.world_from_vertex for vertex in vertices]
    has_certificate = response.HasField("chordal_certificate")
    return PoseGraphSolution(
        np.array([vertex.id for vertex in vertices], np.int64),
        _poses.from_messages(transforms) if kind == "se3" else _poses.from_planar(transforms),
        response.summary,
        list(response.switched_off_edges),
        response.chordal_certificate if has_certificate else None,
        list(response.iterations),
    )


def refine_request(
    camera: Camera,
    world_from_camera: npt.ArrayLike,
    points: npt.ArrayLike,
    pixels: npt.ArrayLike,
    depths: npt.ArrayLike | None,
    sigmas: npt.ArrayLike | None,
    sigma_px: npt.ArrayLike | None,
) -> RefinePoseRequest:
    """A camera over known points."""
    xyz = _poses.shaped("points", points, None, 3)
    if len(xyz) != len(np.asarray(pixels)):
        raise ValueError(f"points must be one a pixel, {len(np.asarray(pixels))}, not {len(xyz)}")
    columns = _rows.nested(1, _rows.doubles(1, xyz))
    columns += _items.measurements(pixels, depths, sigmas, sigma_px, 2)
    pose = _poses.rigid("world_from_camera", world_from_camera)
    request = RefinePoseRequest(camera=camera, world_from_camera=pose)
    request.MergeFromString(_rows.join(_rows.nested(3, columns)))
    return request


def refined(response: RefinePoseResponse) -> RefinedPose:
    """The answer to a camera over known points."""
    information = None
    if response.HasField("information"):
        information = unpack_symmetric(list(response.information.upper_triangle))
    pose = _poses.from_message(response.world_from_camera)
    return RefinedPose(pose, response.summary, information)


def localize_request(
    map_id: str,
    camera: Camera,
    pixels: npt.ArrayLike,
    descriptors: npt.ArrayLike,
    depths: npt.ArrayLike | None,
    sigmas: npt.ArrayLike | None,
    sigma_px: npt.ArrayLike | None,
    name: str,
    kind: str | None,
) -> LocalizeRequest:
    """What a lost camera sees."""
    columns = _items.measurements(pixels, depths, sigmas, sigma_px, 1)
    columns += _items.descriptor(5, descriptors, len(np.asarray(pixels)), name, kind)
    request = LocalizeRequest(map_id=map_id, camera=camera)
    request.MergeFromString(_rows.join(_rows.nested(3, columns)))
    return request


def localization(response: LocalizeResponse) -> Localization | None:
    """The answer to a lost camera."""
    if not response.HasField("world_from_camera"):
        return None
    return Localization(
        _poses.from_message(response.world_from_camera),
        unpack_symmetric(list(response.covariance.upper_triangle)),
        {i.feature: (i.landmark.client_id, i.landmark.id) for i in response.inliers},
        response,
    )


def _rigid(poses: Array) -> _rows.Columns:
    """Fields of N RigidTransform."""
    translation = _rows.nested(1, _rows.doubles(1, poses[:, :3, 3]))
    return translation + _rows.nested(2, _rows.doubles(1, _poses.quaternions(poses[:, :3, :3])))


def _planar(poses: Array) -> _rows.Columns:
    """Fields of N RigidTransform2."""
    angle = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    return _rows.nested(1, _rows.doubles(1, poses[:, :2, 2])) + _rows.doubles(2, angle[:, None])


def _marks(name: str, value: npt.ArrayLike | None, count: int) -> _items.Ids:
    """Booleans, one a row, or none."""
    if value is None:
        return np.zeros(count, np.int64)
    array = np.asarray(value)
    if array.dtype != np.bool_ or array.shape != (count,):
        raise ValueError(f"{name} must be {count} booleans, not {array.dtype} of {array.shape}")
    return array.astype(np.int64)
