import datetime

from covis.v1 import ingest_service_pb2 as _ingest_service_pb2
from covis.v1 import map_pb2 as _map_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class GetServerInfoRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class GetServerInfoResponse(_message.Message):
    __slots__ = ("version", "wire_packages", "instance_id", "start_time", "durability", "lock_step", "limits", "features", "solver_thread_count", "simd_class", "resources")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    WIRE_PACKAGES_FIELD_NUMBER: _ClassVar[int]
    INSTANCE_ID_FIELD_NUMBER: _ClassVar[int]
    START_TIME_FIELD_NUMBER: _ClassVar[int]
    DURABILITY_FIELD_NUMBER: _ClassVar[int]
    LOCK_STEP_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    FEATURES_FIELD_NUMBER: _ClassVar[int]
    SOLVER_THREAD_COUNT_FIELD_NUMBER: _ClassVar[int]
    SIMD_CLASS_FIELD_NUMBER: _ClassVar[int]
    RESOURCES_FIELD_NUMBER: _ClassVar[int]
    version: str
    wire_packages: _containers.RepeatedScalarFieldContainer[str]
    instance_id: str
    start_time: _timestamp_pb2.Timestamp
    durability: _ingest_service_pb2.Durability
    lock_step: bool
    limits: ServerLimits
    features: _containers.RepeatedScalarFieldContainer[str]
    solver_thread_count: int
    simd_class: str
    resources: _containers.RepeatedCompositeFieldContainer[ResourceUsage]
    def __init__(self, version: _Optional[str] = ..., wire_packages: _Optional[_Iterable[str]] = ..., instance_id: _Optional[str] = ..., start_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., durability: _Optional[_Union[_ingest_service_pb2.Durability, str]] = ..., lock_step: bool = ..., limits: _Optional[_Union[ServerLimits, _Mapping]] = ..., features: _Optional[_Iterable[str]] = ..., solver_thread_count: _Optional[int] = ..., simd_class: _Optional[str] = ..., resources: _Optional[_Iterable[_Union[ResourceUsage, _Mapping]]] = ...) -> None: ...

class ResourceUsage(_message.Message):
    __slots__ = ("resource", "held", "limit")
    RESOURCE_FIELD_NUMBER: _ClassVar[int]
    HELD_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    resource: str
    held: int
    limit: int
    def __init__(self, resource: _Optional[str] = ..., held: _Optional[int] = ..., limit: _Optional[int] = ...) -> None: ...

class ServerLimits(_message.Message):
    __slots__ = ("max_receive_message_bytes", "max_send_message_bytes", "max_map_count", "max_concurrent_stream_count", "map_limits")
    MAX_RECEIVE_MESSAGE_BYTES_FIELD_NUMBER: _ClassVar[int]
    MAX_SEND_MESSAGE_BYTES_FIELD_NUMBER: _ClassVar[int]
    MAX_MAP_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_CONCURRENT_STREAM_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAP_LIMITS_FIELD_NUMBER: _ClassVar[int]
    max_receive_message_bytes: int
    max_send_message_bytes: int
    max_map_count: int
    max_concurrent_stream_count: int
    map_limits: _map_pb2.MapLimits
    def __init__(self, max_receive_message_bytes: _Optional[int] = ..., max_send_message_bytes: _Optional[int] = ..., max_map_count: _Optional[int] = ..., max_concurrent_stream_count: _Optional[int] = ..., map_limits: _Optional[_Union[_map_pb2.MapLimits, _Mapping]] = ...) -> None: ...
