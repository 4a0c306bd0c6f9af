import datetime

from covis.v1 import camera_pb2 as _camera_pb2
from covis.v1 import constraint_pb2 as _constraint_pb2
from covis.v1 import geometry_pb2 as _geometry_pb2
from covis.v1 import map_pb2 as _map_pb2
from google.protobuf import field_mask_pb2 as _field_mask_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class MapFormat(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    MAP_FORMAT_UNSPECIFIED: _ClassVar[MapFormat]
    MAP_FORMAT_COLMAP_TEXT: _ClassVar[MapFormat]
    MAP_FORMAT_COLMAP_BINARY: _ClassVar[MapFormat]
    MAP_FORMAT_TUM: _ClassVar[MapFormat]
    MAP_FORMAT_G2O: _ClassVar[MapFormat]
    MAP_FORMAT_PLY: _ClassVar[MapFormat]
    MAP_FORMAT_COVIS: _ClassVar[MapFormat]

class ImportChange(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    IMPORT_CHANGE_UNSPECIFIED: _ClassVar[ImportChange]
    IMPORT_CHANGE_QUATERNIONS_NORMALIZED: _ClassVar[ImportChange]
    IMPORT_CHANGE_SELF_EDGES_LEFT_OUT: _ClassVar[ImportChange]
    IMPORT_CHANGE_FIXED_VERTICES_FREED: _ClassVar[ImportChange]
    IMPORT_CHANGE_LANDMARK_MEASUREMENTS_LEFT_OUT: _ClassVar[ImportChange]
    IMPORT_CHANGE_LANDMARK_PRIORS_LEFT_OUT: _ClassVar[ImportChange]
    IMPORT_CHANGE_UNKNOWN_LINES_LEFT_OUT: _ClassVar[ImportChange]
MAP_FORMAT_UNSPECIFIED: MapFormat
MAP_FORMAT_COLMAP_TEXT: MapFormat
MAP_FORMAT_COLMAP_BINARY: MapFormat
MAP_FORMAT_TUM: MapFormat
MAP_FORMAT_G2O: MapFormat
MAP_FORMAT_PLY: MapFormat
MAP_FORMAT_COVIS: MapFormat
IMPORT_CHANGE_UNSPECIFIED: ImportChange
IMPORT_CHANGE_QUATERNIONS_NORMALIZED: ImportChange
IMPORT_CHANGE_SELF_EDGES_LEFT_OUT: ImportChange
IMPORT_CHANGE_FIXED_VERTICES_FREED: ImportChange
IMPORT_CHANGE_LANDMARK_MEASUREMENTS_LEFT_OUT: ImportChange
IMPORT_CHANGE_LANDMARK_PRIORS_LEFT_OUT: ImportChange
IMPORT_CHANGE_UNKNOWN_LINES_LEFT_OUT: ImportChange

class CreateMapRequest(_message.Message):
    __slots__ = ("map_id", "display_name", "policy")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    DISPLAY_NAME_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    display_name: str
    policy: _map_pb2.MapPolicy
    def __init__(self, map_id: _Optional[str] = ..., display_name: _Optional[str] = ..., policy: _Optional[_Union[_map_pb2.MapPolicy, _Mapping]] = ...) -> None: ...

class CreateMapResponse(_message.Message):
    __slots__ = ("map",)
    MAP_FIELD_NUMBER: _ClassVar[int]
    map: _map_pb2.Map
    def __init__(self, map: _Optional[_Union[_map_pb2.Map, _Mapping]] = ...) -> None: ...

class GetMapRequest(_message.Message):
    __slots__ = ("map_id", "include_digests")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    INCLUDE_DIGESTS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    include_digests: bool
    def __init__(self, map_id: _Optional[str] = ..., include_digests: bool = ...) -> None: ...

class GetMapResponse(_message.Message):
    __slots__ = ("map", "state_hash", "keyframe_ids_digest")
    MAP_FIELD_NUMBER: _ClassVar[int]
    STATE_HASH_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_IDS_DIGEST_FIELD_NUMBER: _ClassVar[int]
    map: _map_pb2.Map
    state_hash: bytes
    keyframe_ids_digest: bytes
    def __init__(self, map: _Optional[_Union[_map_pb2.Map, _Mapping]] = ..., state_hash: _Optional[bytes] = ..., keyframe_ids_digest: _Optional[bytes] = ...) -> None: ...

class UpdateMapRequest(_message.Message):
    __slots__ = ("map_id", "display_name", "policy", "state", "update_mask", "expected_revision")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    DISPLAY_NAME_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    UPDATE_MASK_FIELD_NUMBER: _ClassVar[int]
    EXPECTED_REVISION_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    display_name: str
    policy: _map_pb2.MapPolicy
    state: _map_pb2.MapState
    update_mask: _field_mask_pb2.FieldMask
    expected_revision: int
    def __init__(self, map_id: _Optional[str] = ..., display_name: _Optional[str] = ..., policy: _Optional[_Union[_map_pb2.MapPolicy, _Mapping]] = ..., state: _Optional[_Union[_map_pb2.MapState, str]] = ..., update_mask: _Optional[_Union[_field_mask_pb2.FieldMask, _Mapping]] = ..., expected_revision: _Optional[int] = ...) -> None: ...

class UpdateMapResponse(_message.Message):
    __slots__ = ("map",)
    MAP_FIELD_NUMBER: _ClassVar[int]
    map: _map_pb2.Map
    def __init__(self, map: _Optional[_Union[_map_pb2.Map, _Mapping]] = ...) -> None: ...

class CopyMapRequest(_message.Message):
    __slots__ = ("source_map_id", "new_map_id", "revision", "time", "state")
    SOURCE_MAP_ID_FIELD_NUMBER: _ClassVar[int]
    NEW_MAP_ID_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    source_map_id: str
    new_map_id: str
    revision: int
    time: _timestamp_pb2.Timestamp
    state: _map_pb2.MapState
    def __init__(self, source_map_id: _Optional[str] = ..., new_map_id: _Optional[str] = ..., revision: _Optional[int] = ..., time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., state: _Optional[_Union[_map_pb2.MapState, str]] = ...) -> None: ...

class CopyMapResponse(_message.Message):
    __slots__ = ("map", "revision", "time")
    MAP_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    map: _map_pb2.Map
    revision: int
    time: _timestamp_pb2.Timestamp
    def __init__(self, map: _Optional[_Union[_map_pb2.Map, _Mapping]] = ..., revision: _Optional[int] = ..., time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class ListMapsRequest(_message.Message):
    __slots__ = ("page_size", "page_token")
    PAGE_SIZE_FIELD_NUMBER: _ClassVar[int]
    PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    page_size: int
    page_token: str
    def __init__(self, page_size: _Optional[int] = ..., page_token: _Optional[str] = ...) -> None: ...

class ListMapsResponse(_message.Message):
    __slots__ = ("maps", "next_page_token")
    MAPS_FIELD_NUMBER: _ClassVar[int]
    NEXT_PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    maps: _containers.RepeatedCompositeFieldContainer[_map_pb2.Map]
    next_page_token: str
    def __init__(self, maps: _Optional[_Iterable[_Union[_map_pb2.Map, _Mapping]]] = ..., next_page_token: _Optional[str] = ...) -> None: ...

class DeleteMapRequest(_message.Message):
    __slots__ = ("map_id",)
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    def __init__(self, map_id: _Optional[str] = ...) -> None: ...

class DeleteMapResponse(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class MergeMapsRequest(_message.Message):
    __slots__ = ("target_map_id", "source_map_id", "target_from_source", "constraints", "renamed_clients", "scale")
    TARGET_MAP_ID_FIELD_NUMBER: _ClassVar[int]
    SOURCE_MAP_ID_FIELD_NUMBER: _ClassVar[int]
    TARGET_FROM_SOURCE_FIELD_NUMBER: _ClassVar[int]
    CONSTRAINTS_FIELD_NUMBER: _ClassVar[int]
    RENAMED_CLIENTS_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    target_map_id: str
    source_map_id: str
    target_from_source: _geometry_pb2.RigidTransform
    constraints: _containers.RepeatedCompositeFieldContainer[_constraint_pb2.RelativePoseConstraint]
    renamed_clients: _containers.RepeatedCompositeFieldContainer[RenamedClient]
    scale: float
    def __init__(self, target_map_id: _Optional[str] = ..., source_map_id: _Optional[str] = ..., target_from_source: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., constraints: _Optional[_Iterable[_Union[_constraint_pb2.RelativePoseConstraint, _Mapping]]] = ..., renamed_clients: _Optional[_Iterable[_Union[RenamedClient, _Mapping]]] = ..., scale: _Optional[float] = ...) -> None: ...

class RenamedClient(_message.Message):
    __slots__ = ("client_id", "new_client_id")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    NEW_CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    new_client_id: str
    def __init__(self, client_id: _Optional[str] = ..., new_client_id: _Optional[str] = ...) -> None: ...

class MergeMapsResponse(_message.Message):
    __slots__ = ("map", "target_from_source", "closure_count", "scale")
    MAP_FIELD_NUMBER: _ClassVar[int]
    TARGET_FROM_SOURCE_FIELD_NUMBER: _ClassVar[int]
    CLOSURE_COUNT_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    map: _map_pb2.Map
    target_from_source: _geometry_pb2.RigidTransform
    closure_count: int
    scale: float
    def __init__(self, map: _Optional[_Union[_map_pb2.Map, _Mapping]] = ..., target_from_source: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., closure_count: _Optional[int] = ..., scale: _Optional[float] = ...) -> None: ...

class UndoMergeRequest(_message.Message):
    __slots__ = ("map_id", "source_map_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    SOURCE_MAP_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    source_map_id: str
    def __init__(self, map_id: _Optional[str] = ..., source_map_id: _Optional[str] = ...) -> None: ...

class UndoMergeResponse(_message.Message):
    __slots__ = ("map", "source")
    MAP_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    map: _map_pb2.Map
    source: _map_pb2.Map
    def __init__(self, map: _Optional[_Union[_map_pb2.Map, _Mapping]] = ..., source: _Optional[_Union[_map_pb2.Map, _Mapping]] = ...) -> None: ...

class FileChunk(_message.Message):
    __slots__ = ("path", "offset", "data", "last_chunk")
    PATH_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    LAST_CHUNK_FIELD_NUMBER: _ClassVar[int]
    path: str
    offset: int
    data: bytes
    last_chunk: bool
    def __init__(self, path: _Optional[str] = ..., offset: _Optional[int] = ..., data: _Optional[bytes] = ..., last_chunk: bool = ...) -> None: ...

class ExportMapRequest(_message.Message):
    __slots__ = ("map_id", "format", "all_landmarks")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    ALL_LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    format: MapFormat
    all_landmarks: bool
    def __init__(self, map_id: _Optional[str] = ..., format: _Optional[_Union[MapFormat, str]] = ..., all_landmarks: bool = ...) -> None: ...

class ExportMapResponse(_message.Message):
    __slots__ = ("header", "chunk")
    HEADER_FIELD_NUMBER: _ClassVar[int]
    CHUNK_FIELD_NUMBER: _ClassVar[int]
    header: ExportMapHeader
    chunk: FileChunk
    def __init__(self, header: _Optional[_Union[ExportMapHeader, _Mapping]] = ..., chunk: _Optional[_Union[FileChunk, _Mapping]] = ...) -> None: ...

class ExportMapHeader(_message.Message):
    __slots__ = ("map_id", "revision", "format", "paths")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    PATHS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    revision: int
    format: MapFormat
    paths: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, map_id: _Optional[str] = ..., revision: _Optional[int] = ..., format: _Optional[_Union[MapFormat, str]] = ..., paths: _Optional[_Iterable[str]] = ...) -> None: ...

class ImportMapRequest(_message.Message):
    __slots__ = ("header", "chunk")
    HEADER_FIELD_NUMBER: _ClassVar[int]
    CHUNK_FIELD_NUMBER: _ClassVar[int]
    header: ImportMapHeader
    chunk: FileChunk
    def __init__(self, header: _Optional[_Union[ImportMapHeader, _Mapping]] = ..., chunk: _Optional[_Union[FileChunk, _Mapping]] = ...) -> None: ...

class ImportMapHeader(_message.Message):
    __slots__ = ("map_id", "display_name", "policy", "format", "client_id", "skip_unknown")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    DISPLAY_NAME_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    SKIP_UNKNOWN_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    display_name: str
    policy: _map_pb2.MapPolicy
    format: MapFormat
    client_id: str
    skip_unknown: bool
    def __init__(self, map_id: _Optional[str] = ..., display_name: _Optional[str] = ..., policy: _Optional[_Union[_map_pb2.MapPolicy, _Mapping]] = ..., format: _Optional[_Union[MapFormat, str]] = ..., client_id: _Optional[str] = ..., skip_unknown: bool = ...) -> None: ...

class ImportMapResponse(_message.Message):
    __slots__ = ("map", "warnings")
    MAP_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    map: _map_pb2.Map
    warnings: _containers.RepeatedCompositeFieldContainer[ImportWarning]
    def __init__(self, map: _Optional[_Union[_map_pb2.Map, _Mapping]] = ..., warnings: _Optional[_Iterable[_Union[ImportWarning, _Mapping]]] = ...) -> None: ...

class ImportWarning(_message.Message):
    __slots__ = ("change", "path", "count", "first_line", "description")
    CHANGE_FIELD_NUMBER: _ClassVar[int]
    PATH_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    FIRST_LINE_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    change: ImportChange
    path: str
    count: int
    first_line: int
    description: str
    def __init__(self, change: _Optional[_Union[ImportChange, str]] = ..., path: _Optional[str] = ..., count: _Optional[int] = ..., first_line: _Optional[int] = ..., description: _Optional[str] = ...) -> None: ...

class GetTrajectoryRequest(_message.Message):
    __slots__ = ("map_id", "client_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    client_id: str
    def __init__(self, map_id: _Optional[str] = ..., client_id: _Optional[str] = ...) -> None: ...

class GetTrajectoryResponse(_message.Message):
    __slots__ = ("revision", "poses")
    REVISION_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    revision: int
    poses: _containers.RepeatedCompositeFieldContainer[KeyframePose]
    def __init__(self, revision: _Optional[int] = ..., poses: _Optional[_Iterable[_Union[KeyframePose, _Mapping]]] = ...) -> None: ...

class KeyframePose(_message.Message):
    __slots__ = ("keyframe", "capture_time", "world_from_camera", "world_from_rig")
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    CAPTURE_TIME_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_RIG_FIELD_NUMBER: _ClassVar[int]
    keyframe: _map_pb2.KeyframeRef
    capture_time: _timestamp_pb2.Timestamp
    world_from_camera: _geometry_pb2.RigidTransform
    world_from_rig: _geometry_pb2.RigidTransform
    def __init__(self, keyframe: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ..., capture_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., world_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., world_from_rig: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ...) -> None: ...

class ListKeyframesRequest(_message.Message):
    __slots__ = ("map_id", "page_size", "page_token", "read_mask")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    PAGE_SIZE_FIELD_NUMBER: _ClassVar[int]
    PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    READ_MASK_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    page_size: int
    page_token: str
    read_mask: _field_mask_pb2.FieldMask
    def __init__(self, map_id: _Optional[str] = ..., page_size: _Optional[int] = ..., page_token: _Optional[str] = ..., read_mask: _Optional[_Union[_field_mask_pb2.FieldMask, _Mapping]] = ...) -> None: ...

class ListKeyframesResponse(_message.Message):
    __slots__ = ("revision", "keyframes", "next_page_token")
    REVISION_FIELD_NUMBER: _ClassVar[int]
    KEYFRAMES_FIELD_NUMBER: _ClassVar[int]
    NEXT_PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    revision: int
    keyframes: _containers.RepeatedCompositeFieldContainer[_map_pb2.Keyframe]
    next_page_token: str
    def __init__(self, revision: _Optional[int] = ..., keyframes: _Optional[_Iterable[_Union[_map_pb2.Keyframe, _Mapping]]] = ..., next_page_token: _Optional[str] = ...) -> None: ...

class ListLandmarksRequest(_message.Message):
    __slots__ = ("map_id", "page_size", "page_token", "read_mask")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    PAGE_SIZE_FIELD_NUMBER: _ClassVar[int]
    PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    READ_MASK_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    page_size: int
    page_token: str
    read_mask: _field_mask_pb2.FieldMask
    def __init__(self, map_id: _Optional[str] = ..., page_size: _Optional[int] = ..., page_token: _Optional[str] = ..., read_mask: _Optional[_Union[_field_mask_pb2.FieldMask, _Mapping]] = ...) -> None: ...

class ListLandmarksResponse(_message.Message):
    __slots__ = ("revision", "landmarks", "next_page_token")
    REVISION_FIELD_NUMBER: _ClassVar[int]
    LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    NEXT_PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    revision: int
    landmarks: _containers.RepeatedCompositeFieldContainer[_map_pb2.Landmark]
    next_page_token: str
    def __init__(self, revision: _Optional[int] = ..., landmarks: _Optional[_Iterable[_Union[_map_pb2.Landmark, _Mapping]]] = ..., next_page_token: _Optional[str] = ...) -> None: ...

class ListConstraintsRequest(_message.Message):
    __slots__ = ("map_id", "page_size", "page_token")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    PAGE_SIZE_FIELD_NUMBER: _ClassVar[int]
    PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    page_size: int
    page_token: str
    def __init__(self, map_id: _Optional[str] = ..., page_size: _Optional[int] = ..., page_token: _Optional[str] = ...) -> None: ...

class ListConstraintsResponse(_message.Message):
    __slots__ = ("revision", "constraints", "next_page_token")
    REVISION_FIELD_NUMBER: _ClassVar[int]
    CONSTRAINTS_FIELD_NUMBER: _ClassVar[int]
    NEXT_PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    revision: int
    constraints: _containers.RepeatedCompositeFieldContainer[_constraint_pb2.Constraint]
    next_page_token: str
    def __init__(self, revision: _Optional[int] = ..., constraints: _Optional[_Iterable[_Union[_constraint_pb2.Constraint, _Mapping]]] = ..., next_page_token: _Optional[str] = ...) -> None: ...

class ListPlaceSearchesRequest(_message.Message):
    __slots__ = ("map_id", "page_size", "page_token")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    PAGE_SIZE_FIELD_NUMBER: _ClassVar[int]
    PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    page_size: int
    page_token: str
    def __init__(self, map_id: _Optional[str] = ..., page_size: _Optional[int] = ..., page_token: _Optional[str] = ...) -> None: ...

class ListPlaceSearchesResponse(_message.Message):
    __slots__ = ("revision", "searches", "next_page_token")
    REVISION_FIELD_NUMBER: _ClassVar[int]
    SEARCHES_FIELD_NUMBER: _ClassVar[int]
    NEXT_PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    revision: int
    searches: _containers.RepeatedCompositeFieldContainer[_constraint_pb2.PlaceSearch]
    next_page_token: str
    def __init__(self, revision: _Optional[int] = ..., searches: _Optional[_Iterable[_Union[_constraint_pb2.PlaceSearch, _Mapping]]] = ..., next_page_token: _Optional[str] = ...) -> None: ...

class WatchMapRequest(_message.Message):
    __slots__ = ("map_id", "from_revision", "omit_landmarks", "omit_constraints", "map_uid", "position_resolution_m", "rotation_resolution_rad")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    FROM_REVISION_FIELD_NUMBER: _ClassVar[int]
    OMIT_LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    OMIT_CONSTRAINTS_FIELD_NUMBER: _ClassVar[int]
    MAP_UID_FIELD_NUMBER: _ClassVar[int]
    POSITION_RESOLUTION_M_FIELD_NUMBER: _ClassVar[int]
    ROTATION_RESOLUTION_RAD_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    from_revision: int
    omit_landmarks: bool
    omit_constraints: bool
    map_uid: str
    position_resolution_m: float
    rotation_resolution_rad: float
    def __init__(self, map_id: _Optional[str] = ..., from_revision: _Optional[int] = ..., omit_landmarks: bool = ..., omit_constraints: bool = ..., map_uid: _Optional[str] = ..., position_resolution_m: _Optional[float] = ..., rotation_resolution_rad: _Optional[float] = ...) -> None: ...

class WatchMapResponse(_message.Message):
    __slots__ = ("delta",)
    DELTA_FIELD_NUMBER: _ClassVar[int]
    delta: MapDelta
    def __init__(self, delta: _Optional[_Union[MapDelta, _Mapping]] = ...) -> None: ...

class MapDelta(_message.Message):
    __slots__ = ("base_revision", "revision", "reset", "part_index", "last_part", "state", "cameras", "rigs", "keyframes", "landmarks", "constraints", "removed_keyframes", "removed_landmarks", "removed_constraints", "client_frames", "map_uid", "pending_work")
    BASE_REVISION_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    RESET_FIELD_NUMBER: _ClassVar[int]
    PART_INDEX_FIELD_NUMBER: _ClassVar[int]
    LAST_PART_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    CAMERAS_FIELD_NUMBER: _ClassVar[int]
    RIGS_FIELD_NUMBER: _ClassVar[int]
    KEYFRAMES_FIELD_NUMBER: _ClassVar[int]
    LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    CONSTRAINTS_FIELD_NUMBER: _ClassVar[int]
    REMOVED_KEYFRAMES_FIELD_NUMBER: _ClassVar[int]
    REMOVED_LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    REMOVED_CONSTRAINTS_FIELD_NUMBER: _ClassVar[int]
    CLIENT_FRAMES_FIELD_NUMBER: _ClassVar[int]
    MAP_UID_FIELD_NUMBER: _ClassVar[int]
    PENDING_WORK_FIELD_NUMBER: _ClassVar[int]
    base_revision: int
    revision: int
    reset: bool
    part_index: int
    last_part: bool
    state: _map_pb2.MapState
    cameras: _containers.RepeatedCompositeFieldContainer[_camera_pb2.Camera]
    rigs: _containers.RepeatedCompositeFieldContainer[_camera_pb2.Rig]
    keyframes: _containers.RepeatedCompositeFieldContainer[KeyframePose]
    landmarks: _containers.RepeatedCompositeFieldContainer[_map_pb2.Landmark]
    constraints: _containers.RepeatedCompositeFieldContainer[_constraint_pb2.Constraint]
    removed_keyframes: _containers.RepeatedCompositeFieldContainer[_map_pb2.KeyframeRef]
    removed_landmarks: _containers.RepeatedCompositeFieldContainer[_map_pb2.LandmarkRef]
    removed_constraints: _containers.RepeatedCompositeFieldContainer[_constraint_pb2.ConstraintRef]
    client_frames: _containers.RepeatedCompositeFieldContainer[_map_pb2.ClientFrame]
    map_uid: str
    pending_work: _map_pb2.PendingWork
    def __init__(self, base_revision: _Optional[int] = ..., revision: _Optional[int] = ..., reset: bool = ..., part_index: _Optional[int] = ..., last_part: bool = ..., state: _Optional[_Union[_map_pb2.MapState, str]] = ..., cameras: _Optional[_Iterable[_Union[_camera_pb2.Camera, _Mapping]]] = ..., rigs: _Optional[_Iterable[_Union[_camera_pb2.Rig, _Mapping]]] = ..., keyframes: _Optional[_Iterable[_Union[KeyframePose, _Mapping]]] = ..., landmarks: _Optional[_Iterable[_Union[_map_pb2.Landmark, _Mapping]]] = ..., constraints: _Optional[_Iterable[_Union[_constraint_pb2.Constraint, _Mapping]]] = ..., removed_keyframes: _Optional[_Iterable[_Union[_map_pb2.KeyframeRef, _Mapping]]] = ..., removed_landmarks: _Optional[_Iterable[_Union[_map_pb2.LandmarkRef, _Mapping]]] = ..., removed_constraints: _Optional[_Iterable[_Union[_constraint_pb2.ConstraintRef, _Mapping]]] = ..., client_frames: _Optional[_Iterable[_Union[_map_pb2.ClientFrame, _Mapping]]] = ..., map_uid: _Optional[str] = ..., pending_work: _Optional[_Union[_map_pb2.PendingWork, _Mapping]] = ...) -> None: ...
