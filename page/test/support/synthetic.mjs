// A map that is made up: a robot walks along a figure of eight through a hall whose walls have
// landmarks. Deterministic.

/** Numbers from 0 to 1 from a seed. */
export function random(seed) {
  let state = seed >>> 0;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

export const CLIENT = "robot-1";
export const CAMERA = { widthPx: 640, heightPx: 480, fx: 500, fy: 500, cx: 319.5, cy: 239.5 };

/** Rows of a rotation with the given columns as a quaternion (x, y, z, w). */
function quaternion([a, b, c]) {
  const m = (i, j) => [a, b, c][j][i];
  const trace = m(0, 0) + m(1, 1) + m(2, 2);
  const w = Math.sqrt(Math.max(0, 1 + trace)) / 2;
  if (w > 1e-3) {
    return [(m(2, 1) - m(1, 2)) / (4 * w), (m(0, 2) - m(2, 0)) / (4 * w), (m(1, 0) - m(0, 1)) / (4 * w), w];
  }
  const x = Math.sqrt(Math.max(0, 1 + m(0, 0) - m(1, 1) - m(2, 2))) / 2;
  const y = Math.sqrt(Math.max(0, 1 - m(0, 0) + m(1, 1) - m(2, 2))) / 2;
  const z = Math.sqrt(Math.max(0, 1 - m(0, 0) - m(1, 1) + m(2, 2))) / 2;
  return [x, Math.sign(m(0, 1)) * y || y, Math.sign(m(0, 2)) * z || z, w];
}

/** Pose of keyframe k of n, world with z up: [x, y, z, qx, qy, qz, qw] of world_from_camera. */
export function pose(k, n) {
  const t = (2 * Math.PI * k) / n;
  const forward = [20 * Math.cos(t), 24 * Math.cos(2 * t), 0];
  const length = Math.hypot(...forward);
  const z = forward.map((v) => v / length);
  const y = [0, 0, -1];
  const x = [y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]];
  return [20 * Math.sin(t), 12 * Math.sin(2 * t), 1.5, ...quaternion([x, y, z])];
}

/** A landmark of the hall's walls, floor or pillars. */
export function landmark(next) {
  const kind = next();
  if (kind < 0.25) return [-28 + 56 * next(), -20 + 40 * next(), 0.02 * next()];
  if (kind < 0.8) {
    const along = next() * 2 * (56 + 40);
    const height = 5 * next() ** 1.5;
    if (along < 56) return [-28 + along, -20, height];
    if (along < 112) return [-84 + along, 20, height];
    return along < 152 ? [-28, -132 + along, height] : [28, -172 + along, height];
  }
  const pillar = Math.floor(next() * 12);
  const angle = 2 * Math.PI * next();
  const [x, y] = [-22 + 4 * pillar, pillar % 2 ? 15 : -15];
  return [x + 0.5 * Math.cos(angle), y + 0.5 * Math.sin(angle), 4 * next()];
}

const vector = ([x, y, z]) => ({ x, y, z });
const transform = (p) => ({ translation: vector(p), rotation: { x: p[3], y: p[4], z: p[5], w: p[6] } });

export const keyframePose = (id, p) => ({
  keyframe: { clientId: CLIENT, id: BigInt(id) },
  captureTime: { seconds: BigInt(1_700_000_000 + id), nanos: 0 },
  worldFromCamera: transform(p),
});

export const landmarkMessage = (id, point, observers) => ({
  clientId: CLIENT,
  id: BigInt(id),
  pointInWorld: vector(point),
  referenceKeyframe: { clientId: CLIENT, id: 0n },
  observationCount: BigInt(observers),
  state: 2,
});

/** The fields of a MapDelta that brings a whole map. */
export function wholeMap(keyframes, landmarks, seed = 7) {
  const next = random(seed);
  const poses = Array.from({ length: keyframes }, (_, k) => keyframePose(k, pose(k, keyframes)));
  const points = Array.from({ length: landmarks }, (_, k) =>
    landmarkMessage(k, landmark(next), 1 + Math.floor(14 * next() ** 2)),
  );
  return { reset: true, lastPart: true, state: 1, mapUid: "synthetic", keyframes: poses, landmarks: points };
}
