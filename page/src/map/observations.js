// Observations of keyframes, fetched when they are asked for: they are by far the largest part of a map
// and do not come with `WatchMap`. From them the page computes residuals, errors of landmarks and
// covisibility.
//
// `ListKeyframes` is read twice: once for cameras, odometry and page tokens, which is little, and then
// from the token on that leads to the keyframes whose observations are missing.

import { Reader } from "../wire/reader.js";
import { project } from "./geometry.js";
import { readPose, readRef } from "./model.js";

const PAGE_SIZE = 16;
/** Missing keyframes that are further apart in the list are fetched by calls of their own. */
const LONGEST_GAP = 4 * PAGE_SIZE;
const KEYFRAME_FIELDS = ["camera_id", "odom_from_camera"];

const keyOf = (client, id) => `${client}/${id}`;

export class Observations {
  constructor(client, model) {
    this.client = client;
    this.model = model;
    this.reset();
  }

  reset() {
    /** What is known of each keyframe, in the order of the list. */
    this.entries = new Map();
    this.revision = -1;
  }

  /** Whether each keyframe of the model is known. */
  get isComplete() {
    const { keyframes } = this.model;
    if (this.entries.size < keyframes.size) return false;
    return !this.#unknown();
  }

  #unknown() {
    for (const [client, ids] of this.model.keyframes.clients) {
      for (const id of ids.keys()) if (!this.entries.has(keyOf(client, id))) return true;
    }
    return false;
  }

  /** Reads cameras and odometry of all keyframes. */
  async loadKeyframes(mapId, signal) {
    const entries = new Map();
    let token = "";
    const each = (keyframe) => {
      const key = keyOf(keyframe.client, keyframe.id);
      const known = this.entries.get(key);
      entries.set(key, { ...keyframe, token, observations: known?.observations ?? null });
    };
    await this.#read(mapId, "", KEYFRAME_FIELDS, signal, (page) => {
      page.keyframes.forEach(each);
      token = page.nextToken;
    });
    this.entries = entries;
  }

  /**
   * Fetches observations that are missing: of one keyframe, or of all. `progress` is told how many
   * keyframes are there.
   */
  async load(mapId, key, signal, progress = () => {}) {
    const isKnown = key ? this.entries.has(key) : this.isComplete;
    if (!isKnown) await this.loadKeyframes(mapId, signal);
    const all = [...this.entries.keys()];
    const missing = [];
    all.forEach((name, place) => {
      const isWanted = !key || name === key;
      if (isWanted && !this.entries.get(name).observations) missing.push(place);
    });
    let have = all.length - missing.length;
    for (let k = 0; k < missing.length; ) {
      const first = k;
      while (k + 1 < missing.length && missing[k + 1] - missing[k] <= LONGEST_GAP) k++;
      const wanted = new Set(missing.slice(first, k + 1).map((place) => all[place]));
      const last = all[missing[k]];
      k++;
      const token = this.entries.get(all[missing[first]]).token;
      const started = new Set();
      await this.#read(mapId, token, ["observations"], signal, (page) => {
        let isPast = false;
        for (const keyframe of page.keyframes) {
          const name = keyOf(keyframe.client, keyframe.id);
          isPast ||= started.has(last) && name !== last;
          const entry = this.entries.get(name);
          if (!entry || !wanted.has(name)) continue;
          if (started.has(name)) append(entry.observations, keyframe.observations);
          else {
            entry.observations = keyframe.observations;
            started.add(name);
            have++;
          }
        }
        progress(have, all.length);
        return !isPast;
      });
      // A keyframe that has gone meanwhile has none.
      for (const name of wanted) this.entries.get(name).observations ??= empty();
    }
  }

  async #read(mapId, pageToken, paths, signal, onPage) {
    const fields = { mapId, pageToken, pageSize: PAGE_SIZE, readMask: { paths } };
    const reader = new Reader(new Uint8Array(0));
    const take = (bytes) => onPage(readPage(reader, bytes));
    await this.client.bytes("MapService", "ListKeyframes", fields, take, signal);
  }

  /** What the page knows of a keyframe, or undefined. */
  get(client, id) {
    return this.entries.get(keyOf(client, id));
  }

  /** Calls `each(entry, slot)` for the keyframes whose observations are there. */
  #loaded(each) {
    for (const entry of this.entries.values()) {
      if (!entry.observations) continue;
      const slot = this.model.keyframes.get(entry.client, entry.id);
      if (slot !== undefined) each(entry, slot);
    }
  }

  /**
   * Calls `each(index, landmarkSlot, du, dv, hasPixel, z)` for the observations of a keyframe whose
   * landmark has a position; the residual is predicted - measured, px, z the predicted depth, m.
   */
  residuals(entry, slot, each) {
    const { keyframes, landmarks, cameras } = this.model;
    const camera = cameras.get(keyOf(entry.client, entry.cameraId));
    if (!camera) return;
    const { refs, pixels } = entry.observations;
    const { pose } = keyframes;
    const [tx, ty, tz, x, y, z, w] = pose.subarray(slot * 7, slot * 7 + 7);
    // The rows of camera_from_world's rotation.
    const r = [
      1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w),
      2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w),
      2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y),
    ];
    const point = [0, 0, 0];
    const pixel = [0, 0];
    for (let k = 0; k < refs.length; k++) {
      const landmark = landmarks.get(refs[k].client, refs[k].id);
      if (landmark === undefined || !landmarks.isPositioned[landmark]) continue;
      const a = landmarks.point[landmark * 3] - tx;
      const b = landmarks.point[landmark * 3 + 1] - ty;
      const c = landmarks.point[landmark * 3 + 2] - tz;
      point[0] = r[0] * a + r[1] * b + r[2] * c;
      point[1] = r[3] * a + r[4] * b + r[5] * c;
      point[2] = r[6] * a + r[7] * b + r[8] * c;
      const hasPixel = project(camera, point, pixel);
      each(k, landmark, pixel[0] - pixels[2 * k], pixel[1] - pixels[2 * k + 1], hasPixel, point[2]);
    }
  }

  /** Root mean square of the residuals of each landmark's slot, px; -1 where none is known. */
  errors() {
    const { landmarks } = this.model;
    const sums = new Float64Array(landmarks.count);
    const counts = new Uint32Array(landmarks.count);
    this.#loaded((entry, slot) => {
      this.residuals(entry, slot, (_index, landmark, du, dv, hasPixel) => {
        if (!hasPixel) return;
        sums[landmark] += du * du + dv * dv;
        counts[landmark]++;
      });
    });
    return Float32Array.from(sums, (sum, slot) => (counts[slot] ? Math.sqrt(sum / counts[slot]) : -1));
  }

  /** Pairs of keyframes' slots that see at least `least` landmarks together, with their count. */
  covisibility(least) {
    const { keyframes, landmarks } = this.model;
    const starts = new Uint32Array(landmarks.count + 1);
    const each = (take) =>
      this.#loaded((entry, slot) => {
        for (const { client, id } of entry.observations.refs) {
          const landmark = landmarks.get(client, id);
          if (landmark !== undefined) take(landmark, slot);
        }
      });
    each((landmark) => starts[landmark + 1]++);
    for (let k = 0; k < landmarks.count; k++) starts[k + 1] += starts[k];
    const ends = starts.slice();
    const seenBy = new Uint32Array(starts[landmarks.count]);
    each((landmark, slot) => (seenBy[ends[landmark]++] = slot));
    const counts = new Map();
    for (let k = 0; k < landmarks.count; k++) {
      for (let i = starts[k]; i < starts[k + 1]; i++) {
        for (let j = i + 1; j < starts[k + 1]; j++) {
          const low = Math.min(seenBy[i], seenBy[j]);
          const high = Math.max(seenBy[i], seenBy[j]);
          if (low === high) continue;
          const pair = low * keyframes.capacity + high;
          counts.set(pair, (counts.get(pair) ?? 0) + 1);
        }
      }
    }
    const edges = [];
    for (const [pair, count] of counts) {
      if (count < least) continue;
      const high = pair % keyframes.capacity;
      edges.push({ a: (pair - high) / keyframes.capacity, b: high, count });
    }
    return edges;
  }
}

const empty = () => ({ refs: [], pixels: new Float32Array(0), depths: new Float32Array(0) });

function append(to, from) {
  for (const ref of from.refs) to.refs.push(ref);
  to.pixels = joined(to.pixels, from.pixels);
  to.depths = joined(to.depths, from.depths);
}

function joined(first, second) {
  const all = new Float32Array(first.length + second.length);
  all.set(first);
  all.set(second, first.length);
  return all;
}

/** A ListKeyframesResponse. */
function readPage(reader, bytes) {
  reader.use(bytes);
  const page = { keyframes: [], nextToken: "" };
  while (reader.at < reader.end) {
    const tag = reader.tag();
    if (tag === 18) page.keyframes.push(readKeyframe(reader));
    else if (tag === 26) page.nextToken = new TextDecoder().decode(reader.raw());
    else reader.skip(tag);
  }
  return page;
}

function readKeyframe(reader) {
  const end = reader.message();
  const keyframe = { client: "", id: 0, cameraId: null, odomFromCamera: null };
  const refs = [];
  const pixels = [];
  const depths = [];
  while (reader.at < end) {
    const tag = reader.tag();
    if (tag === 10) keyframe.client = reader.name();
    else if (tag === 16) keyframe.id = reader.int64();
    else if (tag === 32) keyframe.cameraId = reader.int64();
    else if (tag === 66) {
      keyframe.odomFromCamera = new Float64Array(7);
      readPose(reader, keyframe.odomFromCamera, 0);
    } else if (tag === 74) readObservation(reader, refs, pixels, depths);
    else reader.skip(tag);
  }
  keyframe.observations = {
    refs,
    pixels: Float32Array.from(pixels),
    depths: Float32Array.from(depths),
  };
  return keyframe;
}

function readObservation(reader, refs, pixels, depths) {
  const end = reader.message();
  let ref = { client: "", id: 0 };
  let u = 0;
  let v = 0;
  let depth = NaN;
  while (reader.at < end) {
    const tag = reader.tag();
    if (tag === 10) ref = readRef(reader);
    else if (tag === 26) {
      const pixelEnd = reader.message();
      while (reader.at < pixelEnd) {
        const inner = reader.tag();
        if (inner === 9) u = reader.double();
        else if (inner === 17) v = reader.double();
        else reader.skip(inner);
      }
    } else if (tag === 41) depth = reader.double();
    else reader.skip(tag);
  }
  refs.push(ref);
  pixels.push(u, v);
  depths.push(depth);
}
