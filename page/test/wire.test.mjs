// Reading bytes: what the page reads by hand against what the library writes.

import assert from "node:assert/strict";
import { test } from "node:test";

import { MapModel } from "../src/map/model.js";
import { Frames } from "../src/wire/frames.js";
import { Reader } from "../src/wire/reader.js";
import { keyframePose, landmarkMessage, pose } from "./support/synthetic.mjs";
import { frame, wire } from "./support/wire.mjs";

const encode = (delta) => wire.encode(wire.message("WatchMapResponse"), { delta });
const model = () => new MapModel((name, bytes) => wire.decode(wire.message(name), bytes));

test("ids are read to the bit", () => {
  const ids = [0n, 1n, 127n, 128n, 2n ** 31n, 2n ** 49n - 1n, 2n ** 49n, 2n ** 53n - 1n, 2n ** 53n, 2n ** 62n, 2n ** 63n - 1n, -1n, -5n, -(2n ** 63n)];
  for (const id of ids) {
    const bytes = wire.encode(wire.message("LandmarkRef"), { id });
    const reader = new Reader(bytes);
    if (id !== 0n) assert.equal(reader.tag(), 16);
    const read = id === 0n ? 0 : reader.int64();
    assert.equal(BigInt(read), id);
    assert.equal(typeof read, Number.isSafeInteger(Number(id)) ? "number" : "bigint");
  }
});

test("frames are found however the bytes are cut", () => {
  const sent = [0, 1, 300, 70_000, 3].map((size) => Buffer.alloc(size, size));
  const bytes = Buffer.concat([...sent.map((body) => frame(body)), frame(Buffer.from("grpc-status: 0\r\n"), 0x80)]);
  for (const step of [1, 3, 5, 7, 4096, bytes.length]) {
    const frames = new Frames();
    const found = [];
    for (let at = 0; at < bytes.length; at += step) {
      frames.push(bytes.subarray(at, at + step));
      for (let next = frames.next(); next; next = frames.next()) {
        found.push([next.isTrailers, Buffer.from(next.bytes)]);
      }
    }
    assert.deepEqual(found.slice(0, -1).map(([, body]) => body), sent, `in steps of ${step}`);
    assert.deepEqual(found.at(-1), [true, Buffer.from("grpc-status: 0\r\n")]);
  }
});

test("deltas overwrite, remove and reset, and parts are applied together", () => {
  const map = model();
  const first = {
    revision: 3n, reset: true, mapUid: "u", state: 1,
    keyframes: [keyframePose(0, pose(0, 10)), keyframePose(1, pose(1, 10))],
    landmarks: [landmarkMessage(1, [1, 0, -3], 2)],
  };
  assert.equal(map.apply(encode({ ...first, partIndex: 0 })), false);
  assert.equal(map.landmarks.size, 0);
  const rest = { ...first, keyframes: [], landmarks: [landmarkMessage(2, [0, 0, 0], 9)], partIndex: 1, lastPart: true };
  assert.equal(map.apply(encode(rest)), true);
  assert.deepEqual([map.revision, map.uid, map.keyframes.size, map.landmarks.size], [3, "u", 2, 2]);
  const slot = map.landmarks.get("robot-1", 1);
  assert.deepEqual([...map.landmarks.point.subarray(slot * 3, slot * 3 + 3)], [1, 0, -3]);
  assert.equal(map.landmarks.observers[slot], 2);

  const wanted = pose(5, 10);
  map.apply(encode({
    baseRevision: 3n, revision: 5n, lastPart: true, mapUid: "u",
    keyframes: [keyframePose(1, wanted)],
    removedLandmarks: [{ clientId: "robot-1", id: 2n }],
    removedKeyframes: [{ clientId: "robot-1", id: 0n }],
  }));
  assert.deepEqual([map.revision, map.keyframes.size, map.landmarks.size], [5, 1, 1]);
  const kept = map.keyframes.get("robot-1", 1);
  assert.deepEqual([...map.keyframes.pose.subarray(kept * 7, kept * 7 + 7)], wanted);
  assert.equal(map.correction, map.deltas);

  assert.throws(() => map.apply(encode({ baseRevision: 4n, revision: 6n, lastPart: true })), /revision before/);
  assert.throws(() => map.apply(encode({ baseRevision: 5n, revision: 6n, partIndex: 1, lastPart: true })), /part/);
  map.parts.length = 0;
  map.apply(encode({ revision: 9n, reset: true, lastPart: true, mapUid: "v" }));
  assert.deepEqual([map.revision, map.uid, map.keyframes.size, map.landmarks.size], [9, "v", 0, 0]);
});

test("the largest correction of a client's newest keyframe is kept until it is asked for", () => {
  const map = model();
  const send = (fields) => map.apply(encode({ baseRevision: BigInt(map.revision), lastPart: true, mapUid: "u", ...fields }));
  const clientFrames = [{ clientId: "robot-1", keyframe: { clientId: "robot-1", id: 1n } }];
  const start = [pose(0, 0), pose(1, 10)];
  send({ revision: 1n, reset: true, keyframes: start.map((at, k) => keyframePose(k, at)), clientFrames });
  assert.equal(map.takeShift(), 0, "nothing was there before");
  const moved = (at, x) => [at[0] + x, ...at.slice(1)];
  send({ revision: 2n, keyframes: [keyframePose(1, moved(start[1], 0.25)), keyframePose(0, moved(start[0], 9))] });
  send({ revision: 3n, keyframes: [keyframePose(1, moved(start[1], 0.375))] });
  assert.equal(map.takeShift(), 0.25);
  assert.equal(map.takeShift(), 0);
});

test("what is cut off is an error and not a map", () => {
  const bytes = encode({ revision: 1n, reset: true, lastPart: true, landmarks: [landmarkMessage(1, [1, 2, 3], 2)] });
  for (let length = 1; length < bytes.length; length++) {
    const map = model();
    let isWhole = false;
    try {
      isWhole = map.apply(bytes.slice(0, length)) && map.landmarks.size === 1;
    } catch {
      // Told.
    }
    assert.ok(!isWhole, `${length} of ${bytes.length} bytes`);
  }
});
