"""The shortest frontend in Python: makes a map, streams a few keyframes, reads the corrected poses.

Needs grpcio and stubs generated from proto/; README.md beside this file has the commands.
A camera slides along a wall of known points; its start poses are off by some centimeters.
"""

import queue
import sys

import grpc

from covis.v1 import (camera_pb2, geometry_pb2, ingest_service_pb2, ingest_service_pb2_grpc,
                      map_pb2, map_service_pb2, map_service_pb2_grpc)

FOCAL, CX, CY = 500.0, 319.5, 239.5  # px


def point(landmark):
    """A point of an uneven wall about 4 m away, world frame, m."""
    column, row = landmark % 10, landmark // 10
    return (-1.6 + 0.4 * column, -1.1 + 0.4 * row, 4.0 + 0.35 * (landmark * 7 % 5))


def true_position(keyframe):
    return (0.1 * keyframe, 0.0, 0.0)


def start_position(keyframe):
    return (0.11 * keyframe, 0.02 * (keyframe % 2), 0.0)


def vector3(xyz):
    return geometry_pb2.Vector3(x=xyz[0], y=xyz[1], z=xyz[2])


def camera():
    pinhole = camera_pb2.PinholeRadialTangential(fx=FOCAL, fy=FOCAL, cx=CX, cy=CY)
    return camera_pb2.Camera(
        id=0, width_px=640, height_px=480, pinhole_radial_tangential=pinhole)


def keyframe(index):
    """Keyframe `index` with all that it sees; the first one brings the landmarks along."""
    message = map_pb2.Keyframe(id=index, camera_id=0)
    message.capture_time.FromSeconds(100 + index)
    message.world_from_camera.translation.CopyFrom(vector3(start_position(index)))
    message.world_from_camera.rotation.w = 1.0
    x, y, z = true_position(index)
    for landmark in range(60):
        px, py, pz = point(landmark)
        depth = pz - z
        pixel = geometry_pb2.Vector2(
            x=FOCAL * (px - x) / depth + CX, y=FOCAL * (py - y) / depth + CY)
        message.observations.add(
            landmark=map_pb2.LandmarkRef(id=landmark), pixel=pixel,
            depth_m=depth, sigma_depth_m=0.01)
        if index == 0:
            message.landmarks.add(id=landmark, point_in_world=vector3(point(landmark)))
    return message


def requests(outbox):
    """Yields what is put into `outbox`; None half-closes the stream."""
    while (request := outbox.get()) is not None:
        yield request


def main():
    address = sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:7411"
    channel = grpc.insecure_channel(address)
    maps = map_service_pb2_grpc.MapServiceStub(channel)
    ingest = ingest_service_pb2_grpc.IngestServiceStub(channel)
    Request = ingest_service_pb2.IngestRequest

    try:
        maps.DeleteMap(map_service_pb2.DeleteMapRequest(map_id="example-py"))
    except grpc.RpcError as error:
        if error.code() != grpc.StatusCode.NOT_FOUND:
            raise
    maps.CreateMap(map_service_pb2.CreateMapRequest(map_id="example-py"))

    # A frontend with a lossy link keeps items until they are acknowledged; after a break it opens
    # a new stream and goes on at next_sequence (docs/wire.md, "Resume and duplicates").
    outbox = queue.Queue(maxsize=64)
    answers = ingest.Ingest(requests(outbox))
    outbox.put(Request(open=ingest_service_pb2.IngestOpen(map_id="example-py", client_id="robot")))
    sequence = next(answers).opened.next_sequence
    outbox.put(Request(sequence=sequence, camera=camera()))
    for index in range(6):
        outbox.put(Request(sequence=sequence + 1 + index, keyframe=keyframe(index)))
    outbox.put(None)
    for answer in answers:
        ack = answer.ack
        print("item", ack.sequence, ingest_service_pb2.AckStatus.Name(ack.status))
        for violation in ack.violations:
            print("  ", violation.field, violation.description)

    print("keyframe   start x (m)   optimized x (m)   truth (m)")
    for part in maps.GetTrajectory(map_service_pb2.GetTrajectoryRequest(map_id="example-py")):
        for pose in part.poses:
            index = pose.keyframe.id
            x = pose.world_from_camera.translation.x
            start, truth = start_position(index)[0], true_position(index)[0]
            print(f"{index:>8}   {start:>11.4f}   {x:>15.4f}   {truth:>9.4f}")


if __name__ == "__main__":
    main()
