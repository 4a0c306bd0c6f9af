from covis.v1 import camera_pb2 as _camera_pb2
from covis.v1 import constraint_pb2 as _constraint_pb2
from covis.v1 import geometry_pb2 as _geometry_pb2
from covis.v1 import map_pb2 as _map_pb2
from covis.v1 import optimization_pb2 as _optimization_pb2
from covis.v1 import problem_pb2 as _problem_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class MapProblem(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    MAP_PROBLEM_UNSPECIFIED: _ClassVar[MapProblem]
    MAP_PROBLEM_FULL: _ClassVar[MapProblem]
    MAP_PROBLEM_POSE_GRAPH: _ClassVar[MapProblem]

class PoseGraphStart(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    POSE_GRAPH_START_UNSPECIFIED: _ClassVar[PoseGraphStart]
    POSE_GRAPH_START_VERTICES: _ClassVar[PoseGraphStart]
    POSE_GRAPH_START_SPANNING_TREE: _ClassVar[PoseGraphStart]
    POSE_GRAPH_START_ODOMETRY: _ClassVar[PoseGraphStart]
    POSE_GRAPH_START_CHORDAL: _ClassVar[PoseGraphStart]
    POSE_GRAPH_START_AUTO: _ClassVar[PoseGraphStart]
MAP_PROBLEM_UNSPECIFIED: MapProblem
MAP_PROBLEM_FULL: MapProblem
MAP_PROBLEM_POSE_GRAPH: MapProblem
POSE_GRAPH_START_UNSPECIFIED: PoseGraphStart
POSE_GRAPH_START_VERTICES: PoseGraphStart
POSE_GRAPH_START_SPANNING_TREE: PoseGraphStart
POSE_GRAPH_START_ODOMETRY: PoseGraphStart
POSE_GRAPH_START_CHORDAL: PoseGraphStart
POSE_GRAPH_START_AUTO: PoseGraphStart

class RefinePoseRequest(_message.Message):
    __slots__ = ("camera", "world_from_camera", "observations", "loss", "options", "prior", "include_information", "include_covariance")
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    LOSS_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    PRIOR_FIELD_NUMBER: _ClassVar[int]
    INCLUDE_INFORMATION_FIELD_NUMBER: _ClassVar[int]
    INCLUDE_COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    camera: _camera_pb2.Camera
    world_from_camera: _geometry_pb2.RigidTransform
    observations: _containers.RepeatedCompositeFieldContainer[PointObservation]
    loss: _optimization_pb2.Loss
    options: _optimization_pb2.SolverOptions
    prior: RefinePosePrior
    include_information: bool
    include_covariance: bool
    def __init__(self, camera: _Optional[_Union[_camera_pb2.Camera, _Mapping]] = ..., world_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., observations: _Optional[_Iterable[_Union[PointObservation, _Mapping]]] = ..., loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., options: _Optional[_Union[_optimization_pb2.SolverOptions, _Mapping]] = ..., prior: _Optional[_Union[RefinePosePrior, _Mapping]] = ..., include_information: bool = ..., include_covariance: bool = ...) -> None: ...

class PointObservation(_message.Message):
    __slots__ = ("point_in_world", "pixel", "sigma_px", "depth_m", "sigma_depth_m")
    POINT_IN_WORLD_FIELD_NUMBER: _ClassVar[int]
    PIXEL_FIELD_NUMBER: _ClassVar[int]
    SIGMA_PX_FIELD_NUMBER: _ClassVar[int]
    DEPTH_M_FIELD_NUMBER: _ClassVar[int]
    SIGMA_DEPTH_M_FIELD_NUMBER: _ClassVar[int]
    point_in_world: _geometry_pb2.Vector3
    pixel: _geometry_pb2.Vector2
    sigma_px: float
    depth_m: float
    sigma_depth_m: float
    def __init__(self, point_in_world: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., pixel: _Optional[_Union[_geometry_pb2.Vector2, _Mapping]] = ..., sigma_px: _Optional[float] = ..., depth_m: _Optional[float] = ..., sigma_depth_m: _Optional[float] = ...) -> None: ...

class LocalizeRequest(_message.Message):
    __slots__ = ("map_id", "camera", "features", "global_descriptor")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    FEATURES_FIELD_NUMBER: _ClassVar[int]
    GLOBAL_DESCRIPTOR_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    camera: _camera_pb2.Camera
    features: _containers.RepeatedCompositeFieldContainer[Feature]
    global_descriptor: _map_pb2.Descriptor
    def __init__(self, map_id: _Optional[str] = ..., camera: _Optional[_Union[_camera_pb2.Camera, _Mapping]] = ..., features: _Optional[_Iterable[_Union[Feature, _Mapping]]] = ..., global_descriptor: _Optional[_Union[_map_pb2.Descriptor, _Mapping]] = ...) -> None: ...

class Feature(_message.Message):
    __slots__ = ("pixel", "sigma_px", "depth_m", "sigma_depth_m", "descriptor")
    PIXEL_FIELD_NUMBER: _ClassVar[int]
    SIGMA_PX_FIELD_NUMBER: _ClassVar[int]
    DEPTH_M_FIELD_NUMBER: _ClassVar[int]
    SIGMA_DEPTH_M_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTOR_FIELD_NUMBER: _ClassVar[int]
    pixel: _geometry_pb2.Vector2
    sigma_px: float
    depth_m: float
    sigma_depth_m: float
    descriptor: _map_pb2.Descriptor
    def __init__(self, pixel: _Optional[_Union[_geometry_pb2.Vector2, _Mapping]] = ..., sigma_px: _Optional[float] = ..., depth_m: _Optional[float] = ..., sigma_depth_m: _Optional[float] = ..., descriptor: _Optional[_Union[_map_pb2.Descriptor, _Mapping]] = ...) -> None: ...

class LocalizeResponse(_message.Message):
    __slots__ = ("revision", "world_from_camera", "covariance", "inliers", "variance_factor", "candidates", "rivals")
    REVISION_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    INLIERS_FIELD_NUMBER: _ClassVar[int]
    VARIANCE_FACTOR_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    RIVALS_FIELD_NUMBER: _ClassVar[int]
    revision: int
    world_from_camera: _geometry_pb2.RigidTransform
    covariance: _geometry_pb2.Covariance6
    inliers: _containers.RepeatedCompositeFieldContainer[LocalizedFeature]
    variance_factor: float
    candidates: _containers.RepeatedCompositeFieldContainer[_constraint_pb2.PlaceCandidate]
    rivals: _containers.RepeatedCompositeFieldContainer[RivalPose]
    def __init__(self, revision: _Optional[int] = ..., world_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., covariance: _Optional[_Union[_geometry_pb2.Covariance6, _Mapping]] = ..., inliers: _Optional[_Iterable[_Union[LocalizedFeature, _Mapping]]] = ..., variance_factor: _Optional[float] = ..., candidates: _Optional[_Iterable[_Union[_constraint_pb2.PlaceCandidate, _Mapping]]] = ..., rivals: _Optional[_Iterable[_Union[RivalPose, _Mapping]]] = ...) -> None: ...

class RivalPose(_message.Message):
    __slots__ = ("world_from_camera", "covariance", "keyframe", "inlier_count")
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    INLIER_COUNT_FIELD_NUMBER: _ClassVar[int]
    world_from_camera: _geometry_pb2.RigidTransform
    covariance: _geometry_pb2.Covariance6
    keyframe: _map_pb2.KeyframeRef
    inlier_count: int
    def __init__(self, world_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., covariance: _Optional[_Union[_geometry_pb2.Covariance6, _Mapping]] = ..., keyframe: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ..., inlier_count: _Optional[int] = ...) -> None: ...

class LocalizedFeature(_message.Message):
    __slots__ = ("feature", "landmark")
    FEATURE_FIELD_NUMBER: _ClassVar[int]
    LANDMARK_FIELD_NUMBER: _ClassVar[int]
    feature: int
    landmark: _map_pb2.LandmarkRef
    def __init__(self, feature: _Optional[int] = ..., landmark: _Optional[_Union[_map_pb2.LandmarkRef, _Mapping]] = ...) -> None: ...

class RefinePosePrior(_message.Message):
    __slots__ = ("world_from_camera", "information")
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    INFORMATION_FIELD_NUMBER: _ClassVar[int]
    world_from_camera: _geometry_pb2.RigidTransform
    information: _geometry_pb2.InformationMatrix6
    def __init__(self, world_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., information: _Optional[_Union[_geometry_pb2.InformationMatrix6, _Mapping]] = ...) -> None: ...

class RefinePoseResponse(_message.Message):
    __slots__ = ("world_from_camera", "summary", "observations", "information", "covariance")
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    INFORMATION_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    world_from_camera: _geometry_pb2.RigidTransform
    summary: _optimization_pb2.SolveSummary
    observations: _containers.RepeatedCompositeFieldContainer[ObservationResult]
    information: _geometry_pb2.InformationMatrix6
    covariance: _geometry_pb2.Covariance6
    def __init__(self, world_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., summary: _Optional[_Union[_optimization_pb2.SolveSummary, _Mapping]] = ..., observations: _Optional[_Iterable[_Union[ObservationResult, _Mapping]]] = ..., information: _Optional[_Union[_geometry_pb2.InformationMatrix6, _Mapping]] = ..., covariance: _Optional[_Union[_geometry_pb2.Covariance6, _Mapping]] = ...) -> None: ...

class ObservationResult(_message.Message):
    __slots__ = ("squared_error", "inlier", "behind_camera")
    SQUARED_ERROR_FIELD_NUMBER: _ClassVar[int]
    INLIER_FIELD_NUMBER: _ClassVar[int]
    BEHIND_CAMERA_FIELD_NUMBER: _ClassVar[int]
    squared_error: float
    inlier: bool
    behind_camera: bool
    def __init__(self, squared_error: _Optional[float] = ..., inlier: bool = ..., behind_camera: bool = ...) -> None: ...

class OptimizeMapRequest(_message.Message):
    __slots__ = ("map_id", "options", "observation_loss", "constraint_loss", "gauge", "refine_intrinsics", "problem", "certify")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_LOSS_FIELD_NUMBER: _ClassVar[int]
    CONSTRAINT_LOSS_FIELD_NUMBER: _ClassVar[int]
    GAUGE_FIELD_NUMBER: _ClassVar[int]
    REFINE_INTRINSICS_FIELD_NUMBER: _ClassVar[int]
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    CERTIFY_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    options: _optimization_pb2.SolverOptions
    observation_loss: _optimization_pb2.Loss
    constraint_loss: _optimization_pb2.Loss
    gauge: _optimization_pb2.Gauge
    refine_intrinsics: bool
    problem: MapProblem
    certify: bool
    def __init__(self, map_id: _Optional[str] = ..., options: _Optional[_Union[_optimization_pb2.SolverOptions, _Mapping]] = ..., observation_loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., constraint_loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., gauge: _Optional[_Union[_optimization_pb2.Gauge, str]] = ..., refine_intrinsics: bool = ..., problem: _Optional[_Union[MapProblem, str]] = ..., certify: bool = ...) -> None: ...

class OptimizeMapResponse(_message.Message):
    __slots__ = ("iteration", "result")
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    RESULT_FIELD_NUMBER: _ClassVar[int]
    iteration: _optimization_pb2.IterationSummary
    result: OptimizeMapResult
    def __init__(self, iteration: _Optional[_Union[_optimization_pb2.IterationSummary, _Mapping]] = ..., result: _Optional[_Union[OptimizeMapResult, _Mapping]] = ...) -> None: ...

class OptimizeMapResult(_message.Message):
    __slots__ = ("summary", "revision", "camera_count", "keyframe_count", "landmark_count", "observation_count", "constraint_count", "switched_off_constraints", "chordal_certificate", "switched_off_constraint_count")
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    CAMERA_COUNT_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    LANDMARK_COUNT_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    CONSTRAINT_COUNT_FIELD_NUMBER: _ClassVar[int]
    SWITCHED_OFF_CONSTRAINTS_FIELD_NUMBER: _ClassVar[int]
    CHORDAL_CERTIFICATE_FIELD_NUMBER: _ClassVar[int]
    SWITCHED_OFF_CONSTRAINT_COUNT_FIELD_NUMBER: _ClassVar[int]
    summary: _optimization_pb2.SolveSummary
    revision: int
    camera_count: int
    keyframe_count: int
    landmark_count: int
    observation_count: int
    constraint_count: int
    switched_off_constraints: _containers.RepeatedCompositeFieldContainer[_constraint_pb2.SwitchedOffConstraint]
    chordal_certificate: _optimization_pb2.ChordalCertificate
    switched_off_constraint_count: int
    def __init__(self, summary: _Optional[_Union[_optimization_pb2.SolveSummary, _Mapping]] = ..., revision: _Optional[int] = ..., camera_count: _Optional[int] = ..., keyframe_count: _Optional[int] = ..., landmark_count: _Optional[int] = ..., observation_count: _Optional[int] = ..., constraint_count: _Optional[int] = ..., switched_off_constraints: _Optional[_Iterable[_Union[_constraint_pb2.SwitchedOffConstraint, _Mapping]]] = ..., chordal_certificate: _Optional[_Union[_optimization_pb2.ChordalCertificate, _Mapping]] = ..., switched_off_constraint_count: _Optional[int] = ...) -> None: ...

class SolveBundleRequest(_message.Message):
    __slots__ = ("problem", "options", "loss", "refine_intrinsics", "gauge", "include_iterations")
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    LOSS_FIELD_NUMBER: _ClassVar[int]
    REFINE_INTRINSICS_FIELD_NUMBER: _ClassVar[int]
    GAUGE_FIELD_NUMBER: _ClassVar[int]
    INCLUDE_ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    problem: _problem_pb2.BundleProblem
    options: _optimization_pb2.SolverOptions
    loss: _optimization_pb2.Loss
    refine_intrinsics: bool
    gauge: _optimization_pb2.Gauge
    include_iterations: bool
    def __init__(self, problem: _Optional[_Union[_problem_pb2.BundleProblem, _Mapping]] = ..., options: _Optional[_Union[_optimization_pb2.SolverOptions, _Mapping]] = ..., loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., refine_intrinsics: bool = ..., gauge: _Optional[_Union[_optimization_pb2.Gauge, str]] = ..., include_iterations: bool = ...) -> None: ...

class SolveBundleResponse(_message.Message):
    __slots__ = ("problem", "summary", "iterations")
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    problem: _problem_pb2.BundleProblem
    summary: _optimization_pb2.SolveSummary
    iterations: _containers.RepeatedCompositeFieldContainer[_optimization_pb2.IterationSummary]
    def __init__(self, problem: _Optional[_Union[_problem_pb2.BundleProblem, _Mapping]] = ..., summary: _Optional[_Union[_optimization_pb2.SolveSummary, _Mapping]] = ..., iterations: _Optional[_Iterable[_Union[_optimization_pb2.IterationSummary, _Mapping]]] = ...) -> None: ...

class SolvePoseGraphRequest(_message.Message):
    __slots__ = ("se3", "se2", "options", "loss", "start", "include_iterations", "robust", "certify")
    SE3_FIELD_NUMBER: _ClassVar[int]
    SE2_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    LOSS_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    INCLUDE_ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    ROBUST_FIELD_NUMBER: _ClassVar[int]
    CERTIFY_FIELD_NUMBER: _ClassVar[int]
    se3: _problem_pb2.PoseGraphSe3
    se2: _problem_pb2.PoseGraphSe2
    options: _optimization_pb2.SolverOptions
    loss: _optimization_pb2.Loss
    start: PoseGraphStart
    include_iterations: bool
    robust: _optimization_pb2.ClosureRobustness
    certify: bool
    def __init__(self, se3: _Optional[_Union[_problem_pb2.PoseGraphSe3, _Mapping]] = ..., se2: _Optional[_Union[_problem_pb2.PoseGraphSe2, _Mapping]] = ..., options: _Optional[_Union[_optimization_pb2.SolverOptions, _Mapping]] = ..., loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., start: _Optional[_Union[PoseGraphStart, str]] = ..., include_iterations: bool = ..., robust: _Optional[_Union[_optimization_pb2.ClosureRobustness, _Mapping]] = ..., certify: bool = ...) -> None: ...

class SolvePoseGraphResponse(_message.Message):
    __slots__ = ("se3", "se2", "summary", "iterations", "switched_off_edges", "chordal_certificate")
    SE3_FIELD_NUMBER: _ClassVar[int]
    SE2_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    SWITCHED_OFF_EDGES_FIELD_NUMBER: _ClassVar[int]
    CHORDAL_CERTIFICATE_FIELD_NUMBER: _ClassVar[int]
    se3: _problem_pb2.PoseGraphSe3
    se2: _problem_pb2.PoseGraphSe2
    summary: _optimization_pb2.SolveSummary
    iterations: _containers.RepeatedCompositeFieldContainer[_optimization_pb2.IterationSummary]
    switched_off_edges: _containers.RepeatedCompositeFieldContainer[SwitchedOffEdge]
    chordal_certificate: _optimization_pb2.ChordalCertificate
    def __init__(self, se3: _Optional[_Union[_problem_pb2.PoseGraphSe3, _Mapping]] = ..., se2: _Optional[_Union[_problem_pb2.PoseGraphSe2, _Mapping]] = ..., summary: _Optional[_Union[_optimization_pb2.SolveSummary, _Mapping]] = ..., iterations: _Optional[_Iterable[_Union[_optimization_pb2.IterationSummary, _Mapping]]] = ..., switched_off_edges: _Optional[_Iterable[_Union[SwitchedOffEdge, _Mapping]]] = ..., chordal_certificate: _Optional[_Union[_optimization_pb2.ChordalCertificate, _Mapping]] = ...) -> None: ...

class SwitchedOffEdge(_message.Message):
    __slots__ = ("edge_index", "switched_off")
    EDGE_INDEX_FIELD_NUMBER: _ClassVar[int]
    SWITCHED_OFF_FIELD_NUMBER: _ClassVar[int]
    edge_index: int
    switched_off: _optimization_pb2.SwitchedOff
    def __init__(self, edge_index: _Optional[int] = ..., switched_off: _Optional[_Union[_optimization_pb2.SwitchedOff, _Mapping]] = ...) -> None: ...
