from covis.v1 import camera_pb2 as _camera_pb2
from covis.v1 import geometry_pb2 as _geometry_pb2
from covis.v1 import optimization_pb2 as _optimization_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class BundleProblem(_message.Message):
    __slots__ = ("cameras", "poses", "points", "observations")
    CAMERAS_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    cameras: _containers.RepeatedCompositeFieldContainer[_camera_pb2.Camera]
    poses: _containers.RepeatedCompositeFieldContainer[BundlePose]
    points: _containers.RepeatedCompositeFieldContainer[BundlePoint]
    observations: _containers.RepeatedCompositeFieldContainer[BundleObservation]
    def __init__(self, cameras: _Optional[_Iterable[_Union[_camera_pb2.Camera, _Mapping]]] = ..., poses: _Optional[_Iterable[_Union[BundlePose, _Mapping]]] = ..., points: _Optional[_Iterable[_Union[BundlePoint, _Mapping]]] = ..., observations: _Optional[_Iterable[_Union[BundleObservation, _Mapping]]] = ...) -> None: ...

class BundlePose(_message.Message):
    __slots__ = ("camera_index", "world_from_camera", "fixed")
    CAMERA_INDEX_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    FIXED_FIELD_NUMBER: _ClassVar[int]
    camera_index: int
    world_from_camera: _geometry_pb2.RigidTransform
    fixed: bool
    def __init__(self, camera_index: _Optional[int] = ..., world_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., fixed: bool = ...) -> None: ...

class BundlePoint(_message.Message):
    __slots__ = ("point_in_world", "fixed")
    POINT_IN_WORLD_FIELD_NUMBER: _ClassVar[int]
    FIXED_FIELD_NUMBER: _ClassVar[int]
    point_in_world: _geometry_pb2.Vector3
    fixed: bool
    def __init__(self, point_in_world: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., fixed: bool = ...) -> None: ...

class BundleObservation(_message.Message):
    __slots__ = ("pose_index", "point_index", "pixel", "sigma_px", "depth_m", "sigma_depth_m")
    POSE_INDEX_FIELD_NUMBER: _ClassVar[int]
    POINT_INDEX_FIELD_NUMBER: _ClassVar[int]
    PIXEL_FIELD_NUMBER: _ClassVar[int]
    SIGMA_PX_FIELD_NUMBER: _ClassVar[int]
    DEPTH_M_FIELD_NUMBER: _ClassVar[int]
    SIGMA_DEPTH_M_FIELD_NUMBER: _ClassVar[int]
    pose_index: int
    point_index: int
    pixel: _geometry_pb2.Vector2
    sigma_px: float
    depth_m: float
    sigma_depth_m: float
    def __init__(self, pose_index: _Optional[int] = ..., point_index: _Optional[int] = ..., pixel: _Optional[_Union[_geometry_pb2.Vector2, _Mapping]] = ..., sigma_px: _Optional[float] = ..., depth_m: _Optional[float] = ..., sigma_depth_m: _Optional[float] = ...) -> None: ...

class PoseGraphSe3(_message.Message):
    __slots__ = ("vertices", "edges")
    VERTICES_FIELD_NUMBER: _ClassVar[int]
    EDGES_FIELD_NUMBER: _ClassVar[int]
    vertices: _containers.RepeatedCompositeFieldContainer[PoseGraphVertexSe3]
    edges: _containers.RepeatedCompositeFieldContainer[PoseGraphEdgeSe3]
    def __init__(self, vertices: _Optional[_Iterable[_Union[PoseGraphVertexSe3, _Mapping]]] = ..., edges: _Optional[_Iterable[_Union[PoseGraphEdgeSe3, _Mapping]]] = ...) -> None: ...

class PoseGraphVertexSe3(_message.Message):
    __slots__ = ("id", "world_from_vertex", "fixed")
    ID_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_VERTEX_FIELD_NUMBER: _ClassVar[int]
    FIXED_FIELD_NUMBER: _ClassVar[int]
    id: int
    world_from_vertex: _geometry_pb2.RigidTransform
    fixed: bool
    def __init__(self, id: _Optional[int] = ..., world_from_vertex: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., fixed: bool = ...) -> None: ...

class PoseGraphEdgeSe3(_message.Message):
    __slots__ = ("vertex_i", "vertex_j", "vertex_i_from_vertex_j", "information", "loss", "trusted")
    VERTEX_I_FIELD_NUMBER: _ClassVar[int]
    VERTEX_J_FIELD_NUMBER: _ClassVar[int]
    VERTEX_I_FROM_VERTEX_J_FIELD_NUMBER: _ClassVar[int]
    INFORMATION_FIELD_NUMBER: _ClassVar[int]
    LOSS_FIELD_NUMBER: _ClassVar[int]
    TRUSTED_FIELD_NUMBER: _ClassVar[int]
    vertex_i: int
    vertex_j: int
    vertex_i_from_vertex_j: _geometry_pb2.RigidTransform
    information: _geometry_pb2.InformationMatrix6
    loss: _optimization_pb2.Loss
    trusted: bool
    def __init__(self, vertex_i: _Optional[int] = ..., vertex_j: _Optional[int] = ..., vertex_i_from_vertex_j: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., information: _Optional[_Union[_geometry_pb2.InformationMatrix6, _Mapping]] = ..., loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., trusted: bool = ...) -> None: ...

class PoseGraphSe2(_message.Message):
    __slots__ = ("vertices", "edges")
    VERTICES_FIELD_NUMBER: _ClassVar[int]
    EDGES_FIELD_NUMBER: _ClassVar[int]
    vertices: _containers.RepeatedCompositeFieldContainer[PoseGraphVertexSe2]
    edges: _containers.RepeatedCompositeFieldContainer[PoseGraphEdgeSe2]
    def __init__(self, vertices: _Optional[_Iterable[_Union[PoseGraphVertexSe2, _Mapping]]] = ..., edges: _Optional[_Iterable[_Union[PoseGraphEdgeSe2, _Mapping]]] = ...) -> None: ...

class PoseGraphVertexSe2(_message.Message):
    __slots__ = ("id", "world_from_vertex", "fixed")
    ID_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_VERTEX_FIELD_NUMBER: _ClassVar[int]
    FIXED_FIELD_NUMBER: _ClassVar[int]
    id: int
    world_from_vertex: _geometry_pb2.RigidTransform2
    fixed: bool
    def __init__(self, id: _Optional[int] = ..., world_from_vertex: _Optional[_Union[_geometry_pb2.RigidTransform2, _Mapping]] = ..., fixed: bool = ...) -> None: ...

class PoseGraphEdgeSe2(_message.Message):
    __slots__ = ("vertex_i", "vertex_j", "vertex_i_from_vertex_j", "information", "loss", "trusted")
    VERTEX_I_FIELD_NUMBER: _ClassVar[int]
    VERTEX_J_FIELD_NUMBER: _ClassVar[int]
    VERTEX_I_FROM_VERTEX_J_FIELD_NUMBER: _ClassVar[int]
    INFORMATION_FIELD_NUMBER: _ClassVar[int]
    LOSS_FIELD_NUMBER: _ClassVar[int]
    TRUSTED_FIELD_NUMBER: _ClassVar[int]
    vertex_i: int
    vertex_j: int
    vertex_i_from_vertex_j: _geometry_pb2.RigidTransform2
    information: _geometry_pb2.InformationMatrix3
    loss: _optimization_pb2.Loss
    trusted: bool
    def __init__(self, vertex_i: _Optional[int] = ..., vertex_j: _Optional[int] = ..., vertex_i_from_vertex_j: _Optional[_Union[_geometry_pb2.RigidTransform2, _Mapping]] = ..., information: _Optional[_Union[_geometry_pb2.InformationMatrix3, _Mapping]] = ..., loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., trusted: bool = ...) -> None: ...
