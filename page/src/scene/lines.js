// Colored line segments on the GPU, written anew as a whole. The buffer doubles when it is full.

import {
  BufferAttribute, BufferGeometry, DynamicDrawUsage, LineBasicMaterial, LineSegments,
} from "three";

export class Segments {
  constructor(opacity = 1) {
    this.material = new LineBasicMaterial({
      vertexColors: true,
      transparent: opacity < 1,
      opacity,
      depthWrite: opacity === 1,
    });
    this.object = new LineSegments(new BufferGeometry(), this.material);
    this.object.frustumCulled = false;
    this.capacity = 0;
    this.count = 0;
    this.#reserve(256);
  }

  #reserve(vertices) {
    const old = this.object.geometry.attributes;
    const geometry = new BufferGeometry();
    const position = new Float32Array(vertices * 3);
    const tints = new Uint8Array(vertices * 3);
    if (old.position) {
      position.set(old.position.array);
      tints.set(old.color.array);
    }
    const add = (name, attribute) => {
      geometry.setAttribute(name, attribute.setUsage(DynamicDrawUsage));
    };
    add("position", new BufferAttribute(position, 3));
    add("color", new BufferAttribute(tints, 3, true));
    this.object.geometry.dispose();
    this.object.geometry = geometry;
    this.capacity = vertices;
  }

  /** Begins anew. */
  clear() {
    this.count = 0;
  }

  /** Adds a segment of one color, red, green and blue from 0 to 255. */
  add(ax, ay, az, bx, by, bz, [r, g, b]) {
    if (this.count + 2 > this.capacity) this.#reserve(this.capacity * 2);
    const { position, color: tints } = this.object.geometry.attributes;
    const at = this.count * 3;
    const p = position.array;
    const t = tints.array;
    p[at] = ax;
    p[at + 1] = ay;
    p[at + 2] = az;
    p[at + 3] = bx;
    p[at + 4] = by;
    p[at + 5] = bz;
    t[at] = t[at + 3] = r;
    t[at + 1] = t[at + 4] = g;
    t[at + 2] = t[at + 5] = b;
    this.count += 2;
  }

  /** Has what was added drawn. */
  finish() {
    const { geometry } = this.object;
    geometry.setDrawRange(0, this.count);
    for (const attribute of [geometry.attributes.position, geometry.attributes.color]) {
      attribute.addUpdateRange(0, this.count * 3);
      attribute.needsUpdate = true;
    }
  }

  /** Bytes on the GPU. */
  get bytes() {
    return this.capacity * 15;
  }
}
