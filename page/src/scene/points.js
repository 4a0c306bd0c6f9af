// The landmarks of a map as points on the GPU. One buffer for positions and one for colors, which double
// when they are full and of which only what has changed is sent.

import {
  BufferAttribute, BufferGeometry, DynamicDrawUsage, GLSL3, Points, ShaderMaterial,
} from "three";

/** Points of a map this large are drawn with one pixel. */
const MANY_POINTS = 400_000;

// A color for each point, the same for all of its pixels: what a processor that draws by software does
// fastest. Without opacity there is no point.
const VERTEX = `
in vec4 tint;
uniform float size;
flat out vec3 shade;
void main() {
  shade = tint.rgb;
  gl_PointSize = size;
  gl_Position = tint.a > 0.0
    ? projectionMatrix * (modelViewMatrix * vec4(position, 1.0))
    : vec4(2.0, 2.0, 2.0, 1.0);
}`;

const FRAGMENT = `
flat in vec3 shade;
out vec4 color;
void main() { color = vec4(shade, 1.0); }`;

export class LandmarkPoints {
  constructor() {
    this.material = new ShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { size: { value: 2 } },
    });
    this.object = new Points(new BufferGeometry(), this.material);
    this.object.frustumCulled = false;
    this.capacity = 0;
    this.count = 0;
  }

  /** Copies landmarks from slot `from` to before `to`; `tintOf` answers red, green and blue of a slot. */
  update(landmarks, from, to, origin, tintOf) {
    const last = Math.min(to, landmarks.count);
    let first = from;
    if (landmarks.capacity !== this.capacity) {
      this.#allocate(landmarks.capacity);
      first = 0;
    }
    const geometry = this.object.geometry;
    this.count = landmarks.count;
    if (!geometry.index) geometry.setDrawRange(0, this.count);
    this.material.uniforms.size.value = landmarks.count > MANY_POINTS ? 1 : 2;
    if (first >= last) return;
    const { position, tint } = geometry.attributes;
    const { point, isPositioned } = landmarks;
    for (let slot = first; slot < last; slot++) {
      if (!isPositioned[slot]) {
        tint.array[slot * 4 + 3] = 0;
        continue;
      }
      for (let k = 0; k < 3; k++) position.array[slot * 3 + k] = point[slot * 3 + k] - origin[k];
      const [r, g, b] = tintOf(slot);
      tint.array[slot * 4] = r;
      tint.array[slot * 4 + 1] = g;
      tint.array[slot * 4 + 2] = b;
      tint.array[slot * 4 + 3] = 255;
    }
    for (const [attribute, width] of [[position, 3], [tint, 4]]) {
      attribute.addUpdateRange(first * width, (last - first) * width);
      attribute.needsUpdate = true;
    }
  }

  #allocate(capacity) {
    // Three keeps the size that an attribute began with: a larger one needs another geometry.
    if (this.spread) this.object.geometry.index = this.spread;
    this.spread = null;
    this.object.geometry.dispose();
    const geometry = new BufferGeometry();
    const add = (name, array, width, isNormalized) => {
      const attribute = new BufferAttribute(array, width, isNormalized);
      geometry.setAttribute(name, attribute.setUsage(DynamicDrawUsage));
    };
    add("position", new Float32Array(capacity * 3), 3, false);
    add("tint", new Uint8Array(capacity * 4), 4, true);
    this.object.geometry = geometry;
    this.capacity = capacity;
  }

  /** Draws this share of the points, spread evenly over the map's history; all of them with 1. */
  setShare(share) {
    const { geometry } = this.object;
    if (share >= 1) {
      geometry.index = null;
      geometry.setDrawRange(0, this.count);
      return;
    }
    if (!geometry.index) {
      this.#spread();
      geometry.index = this.spread;
    }
    geometry.setDrawRange(0, Math.ceil(this.spreadCount * share));
  }

  /** Puts the slots in an order of which each beginning is spread evenly: bits reversed. */
  #spread() {
    if (this.spread?.count !== this.capacity) {
      this.spread = new BufferAttribute(new Uint32Array(this.capacity), 1);
    }
    const bits = Math.log2(this.capacity);
    const { array } = this.spread;
    let at = 0;
    for (let k = 0; k < this.capacity; k++) {
      let slot = 0;
      for (let bit = 0; bit < bits; bit++) slot |= ((k >> bit) & 1) << (bits - 1 - bit);
      if (slot < this.count) array[at++] = slot;
    }
    this.spreadCount = at;
    this.spread.needsUpdate = true;
  }

  /** Bytes on the GPU. */
  get bytes() {
    return this.capacity * (16 + (this.spread ? 4 : 0));
  }
}
