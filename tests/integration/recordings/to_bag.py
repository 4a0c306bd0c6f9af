"""Writes a rosbag2 folder from frames: to_bag.py FRAMES BAG STORAGE, with the storage sqlite3, mcap or mcap-zstd.

FRAMES has frames.json: the camera, and for each frame its times in nanoseconds, its size and the files with
its bytes (rgb8, and float32 in meters). The bag has other topics beside, as those of robots have.
"""

import json
import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

frames, bag, storage = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
store = get_typestore(Stores.ROS2_HUMBLE)
types = {name.rsplit("/")[-1]: kind for name, kind in store.types.items()}
FRAME = "camera_color_optical_frame"


def header(nanoseconds):
    """A header of this time."""
    seconds, rest = divmod(nanoseconds, 10**9)
    return types["Header"](stamp=types["Time"](sec=seconds, nanosec=rest), frame_id=FRAME)


def image(nanoseconds, encoding, size, path):
    """An image from its bytes."""
    data = np.fromfile(frames / path, dtype=np.uint8)
    return types["Image"](
        header=header(nanoseconds), height=size[1], width=size[0], encoding=encoding, is_bigendian=0,
        step=len(data) // size[1], data=data,
    )  # fmt: skip


def camera_info(nanoseconds, size, camera):
    """The camera of color and depth."""
    fx, fy, cx, cy, *d = camera
    roi = types["RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    p = [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]
    return types["CameraInfo"](
        header=header(nanoseconds), height=size[1], width=size[0], distortion_model="plumb_bob",
        d=np.array(d, float), k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], float), r=np.eye(3).ravel(),
        p=np.array(p, float), binning_x=0, binning_y=0, roi=roi,
    )  # fmt: skip


def imu(nanoseconds):
    """A camera that rests."""
    vector = types["Vector3"]
    return types["Imu"](
        header=header(nanoseconds), orientation=types["Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.zeros(9), angular_velocity=vector(x=0.0, y=0.0, z=0.0),
        angular_velocity_covariance=np.zeros(9), linear_acceleration=vector(x=0.0, y=-9.81, z=0.0),
        linear_acceleration_covariance=np.zeros(9),
    )  # fmt: skip


plugin = StoragePlugin.SQLITE3 if storage == "sqlite3" else StoragePlugin.MCAP
writer = Writer(bag, version=9, storage_plugin=plugin)
if storage == "mcap-zstd":
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
described = json.loads((frames / "frames.json").read_text())
with writer:
    topics = {}
    for topic, kind in {
        "/camera/color/image_raw": "Image",
        "/camera/color/camera_info": "CameraInfo",
        "/camera/aligned_depth_to_color/image_raw": "Image",
        "/camera/aligned_depth_to_color/camera_info": "CameraInfo",
        "/camera/imu": "Imu",
    }.items():
        topics[topic] = writer.add_connection(topic, types[kind].__msgtype__, typestore=store)

    def write(topic, message, nanoseconds):
        """The message, recorded a little later than it was taken."""
        data = store.serialize_cdr(message, message.__msgtype__)
        writer.write(topics[topic], nanoseconds + 3_000_000, data)

    for frame in described["frames"]:
        size, (color, depth) = frame["size"], frame["nanoseconds"]
        info = camera_info(color, size, described["camera"])
        write("/camera/imu", imu(color), color)
        write("/camera/color/camera_info", info, color)
        write("/camera/aligned_depth_to_color/camera_info", info, depth)
        image_depth = image(depth, "32FC1", size, frame["depth"])
        write("/camera/aligned_depth_to_color/image_raw", image_depth, depth)
        write("/camera/color/image_raw", image(color, "rgb8", size, frame["color"]), color)
