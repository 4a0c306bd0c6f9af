// Items of a robot that walks through the synthetic hall, with pixels that fit its map.

import { inverse, project, transform } from "../../src/map/geometry.js";
import { CAMERA, landmark, pose, random } from "./synthetic.mjs";

const { widthPx, heightPx, ...lens } = CAMERA;
const zero = { k1: 0, k2: 0, p1: 0, p2: 0, k3: 0 };
const model = { case: "pinholeRadialTangential", value: { ...lens, ...zero } };
export const camera = { id: 0n, widthPx, heightPx, model };

const vector = ([x, y, z]) => ({ x, y, z });
const rigid = (p) => ({ translation: vector(p), rotation: { x: p[3], y: p[4], z: p[5], w: p[6] } });
const time = (k) => ({ seconds: BigInt(1_700_000_000 + k), nanos: 0 });

/** A robot that sees the landmarks of a hall along a walk of `steps` keyframes. */
export class Robot {
  constructor(steps, landmarks, seed = 7) {
    const next = random(seed);
    this.steps = steps;
    this.points = Array.from({ length: landmarks }, () => landmark(next));
    this.sent = new Set();
  }

  /** Keyframe k, with up to `most` observations; `error(n)` is added to the nth one's pixel, px. */
  keyframe(k, most = 200, error = () => [0, 0]) {
    const worldFromCamera = Float64Array.from(pose(k, this.steps));
    const cameraFromWorld = inverse(worldFromCamera);
    const observations = [];
    const landmarks = [];
    const at = [0, 0, 0];
    const pixel = [0, 0];
    this.points.forEach((point, id) => {
      if (observations.length >= most) return;
      transform(cameraFromWorld, 0, point, at);
      if (at[2] < 0.5 || at[2] > 25 || !project(camera, at, pixel)) return;
      if (pixel[0] < 0 || pixel[0] > widthPx - 1 || pixel[1] < 0 || pixel[1] > heightPx - 1) return;
      const [du, dv] = error(observations.length);
      observations.push({ landmark: { id: BigInt(id) }, pixel: { x: pixel[0] - du, y: pixel[1] - dv } });
      if (this.sent.has(id)) return;
      this.sent.add(id);
      landmarks.push({ id: BigInt(id), pointInWorld: vector(point) });
    });
    return {
      id: BigInt(k),
      captureTime: time(k),
      sensor: { case: "cameraId", value: 0n },
      worldFromCamera: rigid(worldFromCamera),
      observations,
      landmarks,
    };
  }
}

/** A keyframe without camera at a place on the floor, heading along x. */
export const bare = (k, x, y) => ({
  id: BigInt(k),
  captureTime: time(k),
  worldFromCamera: rigid([x, y, 0, 0, 0, 0, 1]),
});

/** A relative pose without rotation; deviations in m and rad. */
export function relative(id, kind, i, j, [x, y], sigma, sigmaRad) {
  const upperTriangle = [];
  for (let row = 0; row < 6; row++) {
    for (let column = row; column < 6; column++) {
      const value = row < 3 ? sigma ** -2 : sigmaRad ** -2;
      upperTriangle.push(row === column ? value : 0);
    }
  }
  return {
    id: BigInt(id),
    kind,
    keyframeI: { id: BigInt(i) },
    keyframeJ: { id: BigInt(j) },
    keyframeIFromKeyframeJ: rigid([x, y, 0, 0, 0, 0, 1]),
    information: { upperTriangle },
  };
}
