// A copy of a map, which deltas keep up to date: what `MapMirror` of the Rust client is, in typed arrays.
//
// Deltas are read from their bytes. Nothing here draws: `changed` counts what changed since it was last
// looked at, and the view draws when it comes to it.

import { Reader } from "../wire/reader.js";
import { Slots } from "./slots.js";

/** A LandmarkState. */
const POSITIONED = 2;

export class MapModel {
  /** `decode` makes an object of the bytes of a message of the wire: for what there is little of. */
  constructor(decode) {
    this.decode = decode;
    this.reader = new Reader(new Uint8Array(0));
    this.landmarks = new Slots({
      point: { type: Float64Array, width: 3 },
      observers: { type: Uint32Array, width: 1 },
      isPositioned: { type: Uint8Array, width: 1 },
      /** Number of the delta that last changed it. */
      delta: { type: Uint32Array, width: 1 },
    });
    this.keyframes = new Slots({
      /** Translation, then rotation (x, y, z, w), world_from_camera. */
      pose: { type: Float64Array, width: 7 },
      time: { type: Float64Array, width: 1 },
      delta: { type: Uint32Array, width: 1 },
    });
    this.parts = [];
    this.clear();
  }

  clear() {
    this.uid = "";
    this.revision = 0;
    this.state = 0;
    this.deltas = 0;
    /** Number of the last delta that moved a keyframe which was there before. */
    this.correction = -1;
    this.shift = 0;
    this.landmarks.clear();
    this.keyframes.clear();
    this.cameras = new Map();
    this.constraints = new Map();
    this.frames = new Map();
    this.parts.length = 0;
    this.#touchAll();
  }

  #touchAll() {
    this.changed = {
      landmarks: { from: 0, to: Number.MAX_SAFE_INTEGER },
      keyframes: true,
      constraints: true,
      order: true,
      frames: true,
      reset: true,
    };
  }

  /**
   * Takes the bytes of a WatchMapResponse. Parts of a delta are applied together: answers whether the
   * model has changed, which it does with the last part.
   */
  apply(bytes) {
    const reader = this.reader;
    reader.use(bytes);
    let delta = null;
    while (reader.at < reader.end) {
      const tag = reader.tag();
      if (tag === 10) delta = reader.raw();
      else reader.skip(tag);
    }
    if (!delta) return false;
    const head = this.#head(delta);
    if (head.index !== this.parts.length) throw new Error("a part of a delta is missing");
    if (!head.isLast) {
      // The bytes belong to the connection.
      this.parts.push(delta.slice());
      return false;
    }
    this.#check(head);
    if (head.reset) {
      const parts = this.parts.slice();
      this.clear();
      this.parts.push(...parts);
    }
    this.deltas++;
    for (const part of this.parts) this.#part(part);
    this.parts.length = 0;
    this.#part(delta);
    this.revision = head.revision;
    return true;
  }

  #check({ reset, base, revision }) {
    if (reset || (base === this.revision && revision >= base)) return;
    throw new Error("a delta does not start from the revision before it");
  }

  /** The fields of a delta that are not entities; they come before or between them. */
  #head(delta) {
    const reader = this.reader;
    reader.use(delta);
    const head = { base: 0, revision: 0, reset: false, index: 0, isLast: false };
    while (reader.at < reader.end) {
      const tag = reader.tag();
      if (tag === 8) head.base = reader.int64();
      else if (tag === 16) head.revision = reader.int64();
      else if (tag === 24) head.reset = reader.bool();
      else if (tag === 32) head.index = reader.uint();
      else if (tag === 40) head.isLast = reader.bool();
      else reader.skip(tag);
    }
    return head;
  }

  #part(delta) {
    const reader = this.reader;
    reader.use(delta);
    const { changed } = this;
    while (reader.at < reader.end) {
      const tag = reader.tag();
      switch (tag) {
        case 48:
          this.state = reader.uint();
          break;
        case 58: {
          const camera = this.decode("Camera", reader.raw());
          this.cameras.set(`${camera.clientId}/${camera.id}`, camera);
          break;
        }
        case 74:
          this.#keyframe(reader);
          break;
        case 82:
          this.#landmark(reader);
          break;
        case 90: {
          const { constraint } = this.decode("Constraint", reader.raw());
          // A kind that this page does not know has no case.
          if (constraint.case) {
            const { clientId, id } = constraint.value;
            this.constraints.set(`${clientId}/${id}`, constraint);
            changed.constraints = true;
          }
          break;
        }
        case 98: {
          const { client, id } = readRef(reader);
          if (this.keyframes.remove(client, id) !== undefined) {
            changed.keyframes = true;
            changed.order = true;
          }
          break;
        }
        case 106: {
          const { client, id } = readRef(reader);
          const slot = this.landmarks.remove(client, id);
          if (slot !== undefined) {
            this.landmarks.isPositioned[slot] = 0;
            this.#touch(slot);
          }
          break;
        }
        case 114: {
          const { client, id } = readRef(reader);
          if (this.constraints.delete(`${client}/${id}`)) changed.constraints = true;
          break;
        }
        case 122: {
          const frame = this.decode("ClientFrame", reader.raw());
          if (frame.keyframe) this.frames.set(frame.clientId, frame);
          else this.frames.delete(frame.clientId);
          changed.frames = true;
          break;
        }
        case 130:
          this.uid = reader.name();
          break;
        default:
          reader.skip(tag);
      }
    }
  }

  #touch(slot) {
    const range = this.changed.landmarks;
    if (slot < range.from) range.from = slot;
    if (slot >= range.to) range.to = slot + 1;
  }

  #landmark(reader) {
    const end = reader.message();
    let client = "";
    let id = 0;
    let observers = 0;
    let state = 0;
    let pointAt = -1;
    while (reader.at < end) {
      const tag = reader.tag();
      if (tag === 10) client = reader.name();
      else if (tag === 16) id = reader.int64();
      else if (tag === 26) {
        pointAt = reader.at;
        reader.skip(tag);
      } else if (tag === 48) observers = reader.uint();
      else if (tag === 56) state = reader.uint();
      else reader.skip(tag);
    }
    const slot = this.landmarks.put(client, id);
    if (pointAt >= 0) {
      reader.at = pointAt;
      readVector(reader, this.landmarks.point, slot * 3);
      reader.at = end;
    }
    this.landmarks.observers[slot] = observers;
    this.landmarks.isPositioned[slot] = pointAt >= 0 && state === POSITIONED ? 1 : 0;
    this.landmarks.delta[slot] = this.deltas;
    this.#touch(slot);
  }

  #keyframe(reader) {
    const end = reader.message();
    let key = null;
    let time = 0;
    let poseAt = -1;
    while (reader.at < end) {
      const tag = reader.tag();
      if (tag === 10) key = readRef(reader);
      else if (tag === 18) time = readTime(reader);
      else if (tag === 26 || tag === 34) {
        poseAt = reader.at;
        reader.skip(tag);
      } else reader.skip(tag);
    }
    if (!key || poseAt < 0) return;
    const { keyframes, changed } = this;
    const slot = keyframes.put(key.client, key.id);
    const [x, y, z] = keyframes.pose.subarray(slot * 7, slot * 7 + 3);
    reader.at = poseAt;
    readPose(reader, keyframes.pose, slot * 7);
    reader.at = end;
    if (keyframes.isNew) changed.order = true;
    else {
      this.correction = this.deltas;
      if (this.#isNewest(key)) {
        const [nowX, nowY, nowZ] = keyframes.pose.subarray(slot * 7, slot * 7 + 3);
        this.shift = Math.max(this.shift, Math.hypot(nowX - x, nowY - y, nowZ - z));
      }
    }
    if (keyframes.time[slot] !== time) changed.order = true;
    keyframes.time[slot] = time;
    keyframes.delta[slot] = this.deltas;
    changed.keyframes = true;
  }

  /** Whether it is the keyframe that its client's frame was computed from. */
  #isNewest({ client, id }) {
    const newest = this.frames.get(client)?.keyframe;
    return newest?.clientId === client && String(newest.id) === String(id);
  }

  /** By how far a correction moved the newest keyframe of a client at most since the last call, m. */
  takeShift() {
    const { shift } = this;
    this.shift = 0;
    return shift;
  }

  /** The keyframes' slots by client, then capture time. */
  order() {
    const { keyframes } = this;
    const clients = [...keyframes.clients.keys()].sort();
    return clients.map((client) => {
      const slots = [...keyframes.clients.get(client).values()];
      slots.sort((a, b) => keyframes.time[a] - keyframes.time[b]);
      return { client, slots };
    });
  }

  /** What has changed since the last call. */
  takeChanges() {
    const { changed } = this;
    this.changed = {
      landmarks: { from: Number.MAX_SAFE_INTEGER, to: 0 },
      keyframes: false,
      constraints: false,
      order: false,
      frames: false,
      reset: false,
    };
    return changed;
  }
}

/** A KeyframeRef, LandmarkRef or ConstraintRef. */
export function readRef(reader) {
  const end = reader.message();
  let client = "";
  let id = 0;
  while (reader.at < end) {
    const tag = reader.tag();
    if (tag === 10) client = reader.name();
    else if (tag === 16) id = reader.int64();
    else reader.skip(tag);
  }
  return { client, id };
}

/** A Timestamp in seconds. */
function readTime(reader) {
  const end = reader.message();
  let seconds = 0;
  let nanos = 0;
  while (reader.at < end) {
    const tag = reader.tag();
    if (tag === 8) seconds = Number(reader.int64());
    else if (tag === 16) nanos = reader.uint();
    else reader.skip(tag);
  }
  return seconds + nanos * 1e-9;
}

/** A Vector3 or the first three numbers of a Quaternion, into `out` from `at` on. */
function readVector(reader, out, at, width = 3) {
  const end = reader.message();
  for (let k = 0; k < width; k++) out[at + k] = 0;
  while (reader.at < end) {
    const tag = reader.tag();
    const k = (tag >> 3) - 1;
    if ((tag & 7) === 1 && k < width) out[at + k] = reader.double();
    else reader.skip(tag);
  }
}

/** A RigidTransform as translation and quaternion. */
export function readPose(reader, out, at) {
  const end = reader.message();
  out.fill(0, at, at + 6);
  out[at + 6] = 1;
  while (reader.at < end) {
    const tag = reader.tag();
    if (tag === 10) readVector(reader, out, at);
    else if (tag === 18) readVector(reader, out, at + 3, 4);
    else reader.skip(tag);
  }
}
