// Rotations, poses and cameras, as docs/conventions.md has them: quaternions (x, y, z, w), poses as
// seven numbers, a camera that looks along +z with y down.

/** Rotates `v` by the quaternion that begins at `at` of `q`, into `out`. */
export function rotate(q, at, v, out) {
  const x = q[at];
  const y = q[at + 1];
  const z = q[at + 2];
  const w = q[at + 3];
  const [a, b, c] = v;
  const tx = 2 * (y * c - z * b);
  const ty = 2 * (z * a - x * c);
  const tz = 2 * (x * b - y * a);
  out[0] = a + w * tx + (y * tz - z * ty);
  out[1] = b + w * ty + (z * tx - x * tz);
  out[2] = c + w * tz + (x * ty - y * tx);
  return out;
}

/** A point of the pose's source frame in its target frame. */
export function transform(pose, at, point, out) {
  rotate(pose, at + 3, point, out);
  out[0] += pose[at];
  out[1] += pose[at + 1];
  out[2] += pose[at + 2];
  return out;
}

/** A point of the pose's target frame in its source frame. */
export function transformBack(pose, at, point, out) {
  const d = [point[0] - pose[at], point[1] - pose[at + 1], point[2] - pose[at + 2]];
  const q = [-pose[at + 3], -pose[at + 4], -pose[at + 5], pose[at + 6]];
  return rotate(q, 0, d, out);
}

/** target_from_source · source_from_other. */
export function compose(a, b) {
  const out = new Float64Array(7);
  transform(a, 0, b.subarray(0, 3), out);
  const [x1, y1, z1, w1] = a.subarray(3);
  const [x2, y2, z2, w2] = b.subarray(3);
  out[3] = w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2;
  out[4] = w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2;
  out[5] = w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2;
  out[6] = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2;
  return out;
}

/** source_from_target of target_from_source. */
export function inverse(a) {
  const out = new Float64Array(7);
  out.set([-a[3], -a[4], -a[5], a[6]], 3);
  const t = rotate(out, 3, [-a[0], -a[1], -a[2]], [0, 0, 0]);
  out.set(t);
  return out;
}

/** The seven numbers of a RigidTransform message. */
export function poseOf({ translation: t, rotation: q }) {
  return Float64Array.of(t?.x ?? 0, t?.y ?? 0, t?.z ?? 0, q?.x ?? 0, q?.y ?? 0, q?.z ?? 0, q?.w ?? 1);
}

/** The angle of a pose's rotation, rad. */
export function angleOf(pose) {
  const sine = Math.hypot(pose[3], pose[4], pose[5]);
  return 2 * Math.atan2(sine, Math.abs(pose[6]));
}

/**
 * The pixel of a point in the camera's frame, into `out`. Answers whether there is one: not of a point
 * that is behind a camera without a fisheye lens.
 */
export function project(camera, [x, y, z], out) {
  const { case: model, value: c } = camera.model;
  if (model === "kannalaBrandt") {
    const r = Math.hypot(x, y);
    const t = Math.atan2(r, z);
    const t2 = t * t;
    const u = t * (1 + t2 * (c.k1 + t2 * (c.k2 + t2 * (c.k3 + t2 * c.k4))));
    const scale = r > 0 ? u / r : 1 / z;
    out[0] = c.fx * scale * x + c.cx;
    out[1] = c.fy * scale * y + c.cy;
    return r > 0 || z > 0;
  }
  if (z <= 0) return false;
  const a = x / z;
  const b = y / z;
  const r2 = a * a + b * b;
  if (model === "snavely") {
    const d = c.focal * (1 + r2 * (c.k1 + r2 * c.k2));
    out[0] = d * a;
    out[1] = d * b;
    return true;
  }
  if (model !== "pinholeRadialTangential") return false;
  const d = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
  out[0] = c.fx * (a * d + 2 * c.p1 * a * b + c.p2 * (r2 + 2 * a * a)) + c.cx;
  out[1] = c.fy * (b * d + c.p1 * (r2 + 2 * b * b) + 2 * c.p2 * a * b) + c.cy;
  return true;
}
