// The map in 3D. It draws when something has changed, and not otherwise.

import {
  ColorManagement, LinearSRGBColorSpace, PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { verdictOf } from "../map/closures.js";
import { compose, inverse, rotate, transform } from "../map/geometry.js";
import { idOf } from "../map/slots.js";
import { Segments } from "./lines.js";
import { PALETTES } from "./palette.js";
import { LandmarkPoints } from "./points.js";

// Colors go to the screen as they stand in the palette.
ColorManagement.enabled = false;

/** Pixels around a keyframe within which a click picks it. */
const PICK_RADIUS_PX = 14;
/** Width of what lies over the left edge, px. */
const MENU_PX = 220;
/** About how many rays are drawn from a keyframe to its landmarks. */
const MAX_RAYS = 300;
/** Residuals of this size and above have the last color, px. */
export const FULL_ERROR_PX = 3;
/** Observers from which on landmarks have the last color. */
export const FULL_OBSERVERS = 12;

/** While the view turns, as many landmarks are drawn as let frames follow each other within this, ms. */
const LONGEST_PERIOD_MS = 25;
/** Where they follow each other sooner than this there is time for more, ms. */
const SHORT_PERIOD_MS = 20;
/** How much one frame counts in the mean of the periods. */
const NEWEST_WEIGHT = 0.3;
/** The least share of the landmarks; where that takes too long as well, pixels are twice as large. */
const LEAST_SHARE = 0.05;
const COARSE_RATIO = 0.5;
/** How long after the last turn all are drawn, ms. */
const REST_MS = 160;

/** What can be shown, in the order of the menu. */
export const LAYERS = {
  landmarks: "Landmarks",
  keyframes: "Keyframes",
  trajectory: "Trajectory, optimized",
  odometry: "Trajectory, odometry alone",
  closures: "Loop closures",
  covisibility: "Covisibility",
  window: "Local window: moved last",
};

export class MapView {
  constructor(canvas, model, observations) {
    this.canvas = canvas;
    this.model = model;
    this.observations = observations;
    this.renderer = new WebGLRenderer({ canvas, antialias: false, powerPreference: "low-power" });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(55, 1, 0.01, 1000);
    this.points = new LandmarkPoints();
    this.lines = {
      covisibility: new Segments(0.45),
      odometry: new Segments(),
      trajectory: new Segments(),
      keyframes: new Segments(),
      closures: new Segments(),
      rays: new Segments(0.35),
    };
    this.scene.add(this.points.object);
    for (const { object } of Object.values(this.lines)) this.scene.add(object);
    this.visible = {
      landmarks: true, keyframes: true, trajectory: true, odometry: false, closures: true,
      covisibility: false, window: true,
    };
    this.shading = "observers";
    this.errors = null;
    this.edges = [];
    this.chosen = null;
    this.origin = null;
    this.stats = { frames: 0, frameMs: 0 };
    /** Of the landmarks, while the view turns. */
    this.share = 1;
    /** Whether pixels are larger then, px of the canvas a pixel of the page, and the mean period, ms. */
    this.isCoarse = false;
    this.ratio = 1;
    this.periodMs = SHORT_PERIOD_MS;
    this.turnedAt = null;
    this.onPick = () => {};
    this.setTheme("dark");
    this.clear();
    new ResizeObserver(() => this.invalidate()).observe(canvas);
    canvas.addEventListener("pointerdown", (event) => (this.pressed = [event.clientX, event.clientY]));
    canvas.addEventListener("pointerup", (event) => this.#pick(event));
    canvas.addEventListener("keydown", (event) => this.#key(event));
  }

  /** Forgets where the map lies and what is selected. */
  clear() {
    this.origin = null;
    this.isTouched = false;
    this.radius = 0;
    this.chosen = null;
    this.errors = null;
    this.edges = [];
    this.order = [];
    this.dirty = { all: true };
    this.invalidate();
  }

  setTheme(name) {
    this.palette = PALETTES[name];
    const [r, g, b] = this.palette.ground;
    this.renderer.setClearColor((r << 16) | (g << 8) | b);
    this.redraw();
  }

  /** Has everything made anew. */
  redraw() {
    this.dirty = { all: true };
    this.invalidate();
  }

  setVisible(layer, isVisible) {
    this.visible[layer] = isVisible;
    this.redraw();
  }

  /** Colors landmarks by "observers", "error" or "plain"; errors by slot, px. */
  setShading(shading, errors = this.errors) {
    this.shading = shading;
    this.errors = errors;
    this.redraw();
  }

  setEdges(edges) {
    this.edges = edges;
    this.redraw();
  }

  /** Selects a keyframe by client and id, or none with null. */
  select(keyframe) {
    this.chosen = keyframe;
    this.redraw();
  }

  /** The slot of the selected keyframe, or null. */
  get selected() {
    const { chosen } = this;
    return chosen ? (this.model.keyframes.get(chosen.client, chosen.id) ?? null) : null;
  }

  /** Has a frame drawn soon. */
  invalidate() {
    if (this.isWaiting) return;
    this.isWaiting = true;
    requestAnimationFrame(() => {
      this.isWaiting = false;
      this.#frame();
    });
  }

  #frame() {
    const begin = performance.now();
    this.#resize();
    this.#pace(begin);
    this.#update();
    this.renderer.render(this.scene, this.camera);
    this.stats.frames++;
    this.stats.frameMs = performance.now() - begin;
    this.onFrame?.();
  }

  /** The view turns or moves. */
  #turned() {
    this.turnedAt = performance.now();
    clearTimeout(this.restTimer);
    this.restTimer = setTimeout(() => {
      this.turnedAt = null;
      this.invalidate();
    }, REST_MS);
    this.invalidate();
  }

  /**
   * Draws fewer landmarks while the view turns on a machine that is too slow for all of them. How slow it
   * is follows from when the browser asks for the next frame: drawing, and what the browser itself does
   * with a frame.
   */
  #pace(begin) {
    const isTurning = this.turnedAt !== null;
    this.points.setShare(isTurning ? this.share : 1);
    this.#setRatio(isTurning && this.isCoarse ? COARSE_RATIO : 1);
    if (!isTurning || this.isPacing) return;
    this.isPacing = true;
    requestAnimationFrame(() => {
      this.isPacing = false;
      // A tab that was hidden tells nothing.
      const took = Math.min(performance.now() - begin, 4 * LONGEST_PERIOD_MS);
      this.periodMs += NEWEST_WEIGHT * (took - this.periodMs);
      if (this.periodMs > LONGEST_PERIOD_MS) {
        if (this.share <= LEAST_SHARE) this.isCoarse = true;
        this.share = Math.max(this.share * 0.85, LEAST_SHARE);
      } else if (this.periodMs < SHORT_PERIOD_MS) this.share = Math.min(this.share * 1.05, 1);
      if (this.share === 1) this.isCoarse = false;
    });
  }

  /** Pixels of the canvas for one of the page. */
  #setRatio(ratio) {
    if (ratio === this.ratio) return;
    this.ratio = ratio;
    this.renderer.setPixelRatio(ratio);
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    if (this.width === width && this.height === height) return;
    this.width = width;
    this.height = height;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    // The middle of the picture is where nothing lies over it: right of what can be shown.
    this.margin = Math.min(MENU_PX, width / 4);
    this.camera.setViewOffset(width, height, -this.margin / 2, 0, width, height);
  }

  #update() {
    const { model, dirty } = this;
    const changes = model.takeChanges();
    if (changes.reset) {
      // Slots are others than before.
      this.errors = null;
      this.edges = [];
      dirty.all = true;
    }
    const { all } = dirty;
    this.dirty = {};
    if (changes.order || all) this.order = model.order();
    if (!this.origin) this.#place();
    if (!this.origin) {
      // Nothing is left to be drawn.
      this.points.update(model.landmarks, 0, 0, [0, 0, 0], null);
      for (const segments of Object.values(this.lines)) {
        segments.clear();
        segments.finish();
      }
      return;
    }
    const range = all ? { from: 0, to: model.landmarks.count } : changes.landmarks;
    this.points.update(model.landmarks, range.from, range.to, this.origin, this.#tint());
    this.points.object.visible = this.visible.landmarks;
    const isMoved = changes.keyframes || all;
    if (isMoved) {
      if (changes.order || all) this.#measure();
      this.#drawKeyframes();
      this.#drawPath();
      this.#drawOdometry();
      this.#drawEdges();
      this.#drawRays();
      if (!this.isTouched) this.#grow();
    }
    if (isMoved || changes.constraints) this.#drawClosures();
  }

  /** The color of a landmark's slot. */
  #tint() {
    const { observers } = this.model.landmarks;
    const { ramp, plain } = this.palette;
    // Few steps, so that no color is computed for each landmark.
    const steps = Array.from({ length: 64 }, (_, k) => blend(ramp, k / 63));
    const tint = (share) => steps[Math.round(63 * Math.min(share, 1))];
    if (this.shading === "error" && this.errors) {
      const { errors } = this;
      return (slot) => (errors[slot] >= 0 ? tint(errors[slot] / FULL_ERROR_PX) : plain);
    }
    if (this.shading !== "observers") return () => plain;
    const full = Math.log2(FULL_OBSERVERS);
    return (slot) => tint(Math.log2(Math.max(observers[slot], 1)) / full);
  }

  /** Finds an origin and where to look from, once there is something to see. */
  #place() {
    const extent = this.#extent();
    if (!extent) return;
    this.origin = extent.center;
    this.fit();
  }

  /** A ball around the keyframes and most of the landmarks; null of an empty map. */
  #extent() {
    const { landmarks, keyframes } = this.model;
    const step = Math.max(1, Math.floor(landmarks.count / 2000));
    const points = [];
    for (let slot = 0; slot < landmarks.count; slot += step) {
      if (landmarks.isPositioned[slot]) points.push(landmarks.point.subarray(slot * 3, slot * 3 + 3));
    }
    const cameras = [];
    for (let slot = 0; slot < keyframes.count; slot++) {
      if (keyframes.owner(slot)) cameras.push(keyframes.pose.subarray(slot * 7, slot * 7 + 3));
    }
    if (points.length + cameras.length === 0) return null;
    const center = [0, 0, 0];
    const half = [0, 0, 0];
    for (let k = 0; k < 3; k++) {
      // Landmarks that are far off do not count.
      const ends = [range(points, k, 0.06), range(cameras, k, 0.005)].filter(Boolean);
      const low = Math.min(...ends.map(([first]) => first));
      const high = Math.max(...ends.map(([, last]) => last));
      center[k] = (low + high) / 2;
      half[k] = (high - low) / 2;
    }
    return { center, radius: Math.max(Math.hypot(...half), 1e-3) };
  }

  /** Looks at the whole map. */
  fit() {
    if (!this.origin) return;
    const { center, radius } = this.#extent();
    this.radius = radius;
    const up = this.#up();
    this.camera.up.copy(up);
    const side = new Vector3(1, 0, 0);
    if (Math.abs(up.dot(side)) > 0.9) side.set(0, 0, 1);
    side.addScaledVector(up, -up.dot(side)).normalize();
    const forward = new Vector3().crossVectors(up, side);
    const target = new Vector3(...center.map((v, k) => v - this.origin[k]));
    const direction = forward.multiplyScalar(-0.8).addScaledVector(up, 0.75).addScaledVector(side, 0.45);
    this.camera.near = radius * 0.005;
    this.camera.far = radius * 60;
    this.camera.updateProjectionMatrix();
    // As far off as has the ball in the picture, up and down and from side to side.
    const halfHeight = Math.tan((this.camera.fov * Math.PI) / 360);
    const free = Math.max((this.width - this.margin) / this.height, 0.3);
    const distance = radius / Math.sin(Math.atan(halfHeight * Math.min(free, 1)));
    this.camera.position.copy(target).addScaledVector(direction.normalize(), distance || radius * 2);
    // The controls keep the direction that was up when they were made.
    this.controls?.dispose();
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.target.copy(target);
    this.controls.addEventListener("change", () => this.#turned());
    this.controls.addEventListener("start", () => (this.isTouched = true));
    this.controls.update();
    this.#measure();
    this.redraw();
  }

  /** Looks at the whole map again when it has become much larger. */
  #grow() {
    const count = this.model.keyframes.size + this.model.landmarks.size;
    if (this.measuredAt && count < this.measuredAt * 1.3) return;
    this.measuredAt = count;
    if (this.#extent().radius > this.radius * 1.25) this.fit();
  }

  /** Up in the world: against the y of cameras, or along the z of vehicles that turn about it. */
  #up() {
    const { keyframes } = this.model;
    const camera = new Vector3();
    const vehicle = new Vector3();
    for (let slot = 0; slot < keyframes.count; slot++) {
      if (!keyframes.owner(slot)) continue;
      camera.add(new Vector3(...rotate(keyframes.pose, slot * 7 + 3, [0, -1, 0], [0, 0, 0])));
      vehicle.add(new Vector3(...rotate(keyframes.pose, slot * 7 + 3, [0, 0, 1], [0, 0, 0])));
    }
    // What is up stays so on the way; the other direction comes around.
    const up = vehicle.length() > 1.5 * camera.length() ? vehicle : camera;
    return up.lengthSq() > 1e-6 ? up.normalize() : new Vector3(0, -1, 0);
  }

  /** How large keyframes are drawn: by the usual way from one to the next. */
  #measure() {
    const { pose } = this.model.keyframes;
    const steps = [];
    for (const { slots } of this.order) {
      for (let k = 1; k < slots.length; k++) {
        const [a, b] = [slots[k - 1] * 7, slots[k] * 7];
        steps.push(Math.hypot(pose[a] - pose[b], pose[a + 1] - pose[b + 1], pose[a + 2] - pose[b + 2]));
      }
    }
    const wanted = steps.length > 0 ? median(steps) * 0.6 : 0;
    this.size = Math.min(Math.max(wanted, this.radius * 0.004), this.radius * 0.05);
  }

  #clientTint(client) {
    const clients = [...this.model.keyframes.clients.keys()].sort();
    const { clients: tints } = this.palette;
    return tints[Math.max(clients.indexOf(client), 0) % tints.length];
  }

  #at(slot) {
    const { pose } = this.model.keyframes;
    return [0, 1, 2].map((k) => pose[slot * 7 + k] - this.origin[k]);
  }

  #drawKeyframes() {
    const { keyframes, correction } = this.model;
    const segments = this.lines.keyframes;
    segments.clear();
    const s = this.size;
    const { selected } = this;
    const corners = [[-s, -0.75 * s, s], [s, -0.75 * s, s], [s, 0.75 * s, s], [-s, 0.75 * s, s]];
    const p = corners.map(() => [0, 0, 0]);
    for (const { client, slots } of this.order) {
      const tint = this.#clientTint(client);
      for (const slot of slots) {
        const isMoved = this.visible.window && keyframes.delta[slot] === correction;
        if (!this.visible.keyframes && !isMoved && slot !== selected) continue;
        let color = isMoved ? this.palette.window : tint;
        if (slot === selected) color = this.palette.selected;
        const c = this.#at(slot);
        corners.forEach((corner, k) => {
          transform(keyframes.pose, slot * 7, corner, p[k]);
          for (let i = 0; i < 3; i++) p[k][i] -= this.origin[i];
        });
        for (let k = 0; k < 4; k++) {
          segments.add(...c, ...p[k], color);
          segments.add(...p[k], ...p[(k + 1) % 4], color);
        }
      }
    }
    segments.finish();
  }

  #drawPath() {
    const segments = this.lines.trajectory;
    segments.clear();
    if (this.visible.trajectory) {
      for (const { client, slots } of this.order) {
        const tint = this.#clientTint(client);
        for (let k = 1; k < slots.length; k++) {
          segments.add(...this.#at(slots[k - 1]), ...this.#at(slots[k]), tint);
        }
      }
    }
    segments.finish();
  }

  /** Odometry alone, laid on the first keyframe that has any. */
  #drawOdometry() {
    const segments = this.lines.odometry;
    segments.clear();
    if (this.visible.odometry) {
      const { keyframes } = this.model;
      for (const { client, slots } of this.order) {
        let worldFromOdom = null;
        let last = null;
        for (const slot of slots) {
          const odom = this.observations.get(client, keyframes.owner(slot).id)?.odomFromCamera;
          if (!odom) continue;
          const pose = keyframes.pose.subarray(slot * 7, slot * 7 + 7);
          worldFromOdom ??= compose(pose, inverse(odom));
          const at = compose(worldFromOdom, odom).subarray(0, 3).map((v, k) => v - this.origin[k]);
          if (last) segments.add(...last, ...at, this.palette.odometry);
          last = at;
        }
      }
    }
    segments.finish();
  }

  #drawEdges() {
    const segments = this.lines.covisibility;
    segments.clear();
    if (this.visible.covisibility) {
      const { keyframes } = this.model;
      for (const { a, b } of this.edges) {
        if (!keyframes.owner(a) || !keyframes.owner(b)) continue;
        segments.add(...this.#at(a), ...this.#at(b), this.palette.covisibility);
      }
    }
    segments.finish();
  }

  #drawClosures() {
    const segments = this.lines.closures;
    segments.clear();
    if (this.visible.closures) {
      const { keyframes, constraints } = this.model;
      for (const constraint of constraints.values()) {
        const verdict = verdictOf(constraint);
        if (!verdict) continue;
        const { keyframeI: i, keyframeJ: j } = constraint.value;
        const a = keyframes.get(i.clientId, idOf(i.id));
        const b = keyframes.get(j.clientId, idOf(j.id));
        if (a === undefined || b === undefined) continue;
        segments.add(...this.#at(a), ...this.#at(b), this.palette[verdict]);
      }
    }
    segments.finish();
  }

  /** Rays from the selected keyframe to what it observes, colored by residual. */
  #drawRays() {
    const segments = this.lines.rays;
    segments.clear();
    const { selected } = this;
    const entry = selected !== null && this.observations.get(this.chosen.client, this.chosen.id);
    if (entry?.observations) {
      const c = this.#at(selected);
      const { point } = this.model.landmarks;
      const step = Math.ceil(entry.observations.refs.length / MAX_RAYS);
      this.observations.residuals(entry, selected, (k, landmark, du, dv, hasPixel) => {
        if (!hasPixel || k % step !== 0) return;
        const at = [0, 1, 2].map((k) => point[landmark * 3 + k] - this.origin[k]);
        segments.add(...c, ...at, this.errorTint(Math.hypot(du, dv)));
      });
    }
    segments.finish();
  }

  /** The color of a residual, px. */
  errorTint(error) {
    return blend(this.palette.ramp, Math.min(error / FULL_ERROR_PX, 1));
  }

  #pick(event) {
    const [x, y] = this.pressed ?? [Infinity, Infinity];
    // A drag turns the view and picks nothing.
    if (Math.hypot(event.clientX - x, event.clientY - y) > 4 || !this.origin) return;
    const bounds = this.canvas.getBoundingClientRect();
    const [px, py] = [event.clientX - bounds.left, event.clientY - bounds.top];
    const { keyframes } = this.model;
    const v = new Vector3();
    let best = null;
    for (let slot = 0; slot < keyframes.count; slot++) {
      if (!keyframes.owner(slot)) continue;
      v.set(...this.#at(slot)).project(this.camera);
      if (v.z < -1 || v.z > 1) continue;
      const [sx, sy] = [((v.x + 1) / 2) * bounds.width, ((1 - v.y) / 2) * bounds.height];
      const distance = Math.hypot(sx - px, sy - py);
      if (distance > PICK_RADIUS_PX) continue;
      if (!best || distance < best.distance) best = { slot, distance };
    }
    if (best) this.onPick(best.slot);
  }

  /** Where a keyframe is on the canvas, px; for tests and for whoever points at it. */
  screenPosition(slot) {
    const v = new Vector3(...this.#at(slot)).project(this.camera);
    return [((v.x + 1) / 2) * this.width, ((1 - v.y) / 2) * this.height];
  }

  #key(event) {
    if (!this.controls || event.ctrlKey || event.metaKey || event.altKey) return;
    const turns = {
      ArrowLeft: [0.12, 0], ArrowRight: [-0.12, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1],
    };
    const zooms = { "+": 0.85, "=": 0.85, "-": 1 / 0.85 };
    if (turns[event.key]) this.turn(...turns[event.key]);
    else if (zooms[event.key]) this.zoom(zooms[event.key]);
    else if (event.key === "Home") this.fit();
    else return;
    event.preventDefault();
  }

  /** Turns around what is looked at: about up, and about the camera's x, rad. */
  turn(around, over) {
    const { camera, controls } = this;
    const offset = camera.position.clone().sub(controls.target);
    offset.applyQuaternion(new Quaternion().setFromAxisAngle(camera.up, around));
    const side = new Vector3().crossVectors(camera.up, offset).normalize();
    const tilted = offset.clone().applyQuaternion(new Quaternion().setFromAxisAngle(side, -over));
    // Not over the top, where up has no direction.
    if (Math.abs(tilted.clone().normalize().dot(camera.up)) < 0.99) offset.copy(tilted);
    camera.position.copy(controls.target).add(offset);
    this.isTouched = true;
    controls.update();
    this.#turned();
  }

  zoom(factor) {
    const { camera, controls } = this;
    camera.position.sub(controls.target).multiplyScalar(factor).add(controls.target);
    this.isTouched = true;
    controls.update();
    this.#turned();
  }

  /** Bytes of the buffers that grow with the map. */
  get gpuBytes() {
    return Object.values(this.lines).reduce((sum, { bytes }) => sum + bytes, this.points.bytes);
  }
}

/** The color at `share`, 0 to 1, of colors in equal steps. */
function blend(colors, share) {
  const place = share * (colors.length - 1);
  const low = Math.min(Math.floor(place), colors.length - 2);
  return colors[low].map((value, k) => Math.round(value + (colors[low + 1][k] - value) * (place - low)));
}

/** Where the values of a coordinate begin and end but for this share at either end. */
function range(points, k, share) {
  if (points.length === 0) return null;
  const sorted = Float64Array.from(points, (point) => point[k]).sort();
  const off = Math.floor(share * (sorted.length - 1));
  return [sorted[off], sorted[sorted.length - 1 - off]];
}

function median(values) {
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.floor(sorted.length / 2)];
}
