// The tab "Keyframe": one keyframe, its observations on the image plane, and their residuals.

import { count, el, replace, say, table, terms } from "../dom.js";
import { idOf } from "../map/slots.js";
import { FULL_ERROR_PX } from "../scene/view.js";

/** How much longer residuals are drawn than they are. */
const ENLARGED = 10;
const WORST = 8;

export class KeyframePanel {
  constructor(app) {
    this.app = app;
    this.title = "Keyframe";
    this.chosen = null;
    const step = (by) => () => this.#step(by);
    this.input = el("input", { id: "keyframe-name", placeholder: "client/id", spellcheck: false, autocomplete: "off" });
    const bar = el("form", { className: "row", onsubmit: (event) => this.#submit(event) },
      el("label", { className: "hidden", htmlFor: "keyframe-name" }, "Keyframe, as client/id"),
      this.input,
      el("button", { type: "submit" }, "Go"),
      el("button", { type: "button", "aria-label": "Keyframe before", onclick: step(-1) }, "‹"),
      el("button", { type: "button", "aria-label": "Next keyframe", onclick: step(1) }, "›"),
    );
    this.plane = el("canvas", { className: "plane", role: "img", width: 640, height: 480, hidden: true });
    this.note = el("p", { className: "note" }, "Click a keyframe in the view, or go through them here.");
    this.facts = el("div");
    this.worst = el("div");
    this.node = el("div", {}, bar, this.note, this.facts, this.plane, this.worst);
  }

  clear() {
    this.chosen = null;
    this.update();
  }

  #submit(event) {
    event.preventDefault();
    const named = /^(.*)\/(-?\d+)$/.exec(this.input.value.trim());
    if (named) this.app.chooseKeyframe(named[1], idOf(named[2]));
    else this.note.textContent = "A keyframe is named as client/id, for instance robot/12.";
  }

  /** Goes on along the trajectory. */
  #step(by) {
    const { model } = this.app;
    const slots = model.order().flatMap((track) => track.slots);
    if (slots.length === 0) return;
    const now = this.chosen ? slots.indexOf(model.keyframes.get(this.chosen.client, this.chosen.id)) : -1;
    const next = now < 0 ? (by > 0 ? 0 : slots.length - 1) : (now + by + slots.length) % slots.length;
    const { client, id } = model.keyframes.owner(slots[next]);
    this.app.chooseKeyframe(client, id);
  }

  /** Shows a keyframe and fetches its observations. */
  async choose(client, id, signal) {
    const { app } = this;
    this.chosen = { client, id };
    this.input.value = `${client}/${id}`;
    this.note.textContent = "Reading its observations …";
    this.update();
    try {
      await app.observations.load(app.mapId, `${client}/${id}`, signal);
      this.note.textContent = "";
    } catch (error) {
      if (!signal.aborted) this.note.textContent = error.message;
    }
    if (signal.aborted) return;
    this.update();
    app.view.redraw();
    say(`Keyframe ${client} ${id}: ${this.summary ?? "no observations"}`);
  }

  update() {
    const { model, observations } = this.app;
    const slot = this.chosen ? model.keyframes.get(this.chosen.client, this.chosen.id) : undefined;
    if (slot === undefined) {
      this.plane.hidden = true;
      this.summary = null;
      if (this.chosen) this.note.textContent = "There is no such keyframe.";
      replace(this.facts);
      replace(this.worst);
      return;
    }
    const pose = model.keyframes.pose.subarray(slot * 7, slot * 7 + 7);
    const when = new Date(model.keyframes.time[slot] * 1000);
    const rows = [
      ["Captured", Number.isFinite(when.getTime()) ? when.toISOString().replace("T", " ").slice(0, 23) : "–"],
      ["Position in world, m", [...pose.subarray(0, 3)].map((v) => v.toFixed(3)).join("  ")],
    ];
    const entry = observations.get(this.chosen.client, this.chosen.id);
    const camera = entry && model.cameras.get(`${entry.client}/${entry.cameraId}`);
    const residuals = [];
    if (entry?.observations) {
      observations.residuals(entry, slot, (k, landmark, du, dv, hasPixel, z) => {
        const dz = z - entry.observations.depths[k];
        residuals.push({ k, landmark, du, dv, dz, hasPixel, error: Math.hypot(du, dv) });
      });
      const seen = residuals.filter((r) => r.hasPixel);
      const rmse = rootMeanSquare(seen.map((r) => r.error));
      const depths = seen.map((r) => r.dz).filter(Number.isFinite);
      const sorted = seen.map((r) => r.error).sort((a, b) => a - b);
      rows.push(
        ["Observations", count(entry.observations.refs.length)],
        ["of landmarks with a position", count(residuals.length)],
        ["behind the camera", count(residuals.length - seen.length)],
        ["Residuals, RMSE, px", rmse.toFixed(3)],
        ["median, px", (sorted[sorted.length >> 1] ?? 0).toFixed(3)],
        ["largest, px", (sorted.at(-1) ?? 0).toFixed(3)],
      );
      if (depths.length > 0) rows.push(["Depths, RMSE, m", rootMeanSquare(depths).toFixed(4)]);
      this.summary = `${seen.length} observations, residuals ${rmse.toFixed(2)} pixels RMSE`;
    }
    replace(this.facts, el("h2", {}, `${this.chosen.client}/${this.chosen.id}`), terms(rows));
    this.#draw(entry, camera, residuals);
    this.#list(entry, residuals);
  }

  /** The image plane: pixels as measured, and from each a line along its residual. */
  #draw(entry, camera, residuals) {
    this.plane.hidden = residuals.length === 0;
    if (this.plane.hidden) return;
    const { pixels } = entry.observations;
    const [width, height, left, top] = extent(camera, pixels);
    this.plane.width = 640;
    this.plane.height = Math.round((640 * height) / width);
    const scale = 640 / width;
    const context = this.plane.getContext("2d");
    for (const { k, du, dv, hasPixel, error } of residuals) {
      if (!hasPixel) continue;
      const [x, y] = [(pixels[2 * k] - left) * scale, (pixels[2 * k + 1] - top) * scale];
      const color = `rgb(${this.app.view.errorTint(error).join(" ")})`;
      context.strokeStyle = color;
      context.fillStyle = color;
      context.lineWidth = 1.5;
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + du * scale * ENLARGED, y + dv * scale * ENLARGED);
      context.stroke();
      context.fillRect(x - 1.5, y - 1.5, 3, 3);
    }
    const label = `Image plane of ${width} by ${height} pixels: ${this.summary}. Residuals are drawn ${ENLARGED} times as long; the last color begins at ${FULL_ERROR_PX} pixels.`;
    this.plane.setAttribute("aria-label", label);
  }

  #list(entry, residuals) {
    const worst = residuals.filter((r) => r.hasPixel).sort((a, b) => b.error - a.error).slice(0, WORST);
    if (worst.length === 0) {
      replace(this.worst);
      return;
    }
    const rows = worst.map(({ k, landmark, du, dv, error }) => {
      const { client, id } = entry.observations.refs[k];
      const observers = this.app.model.landmarks.observers[landmark];
      return [`${client}/${id}`, count(observers), `${du.toFixed(2)}, ${dv.toFixed(2)}`, error.toFixed(2)];
    });
    const columns = [
      { name: "Landmark" },
      { name: "Seen by", number: true },
      { name: "Predicted − measured, px", number: true },
      { name: "Length, px", number: true },
    ];
    const legend = `Points are measured pixels, lines residuals, ${ENLARGED} times as long.`;
    replace(this.worst, el("p", { className: "note" }, legend), table("Largest residuals", columns, rows));
  }
}

const rootMeanSquare = (values) =>
  Math.sqrt(values.reduce((sum, value) => sum + value ** 2, 0) / Math.max(values.length, 1));

/** Width, height, left and top of the image; of its pixels where the camera does not say. */
function extent(camera, pixels) {
  if (camera?.widthPx > 0 && camera?.heightPx > 0) return [camera.widthPx, camera.heightPx, -0.5, -0.5];
  let [left, top, right, bottom] = [Infinity, Infinity, -Infinity, -Infinity];
  for (let k = 0; k < pixels.length; k += 2) {
    left = Math.min(left, pixels[k]);
    right = Math.max(right, pixels[k]);
    top = Math.min(top, pixels[k + 1]);
    bottom = Math.max(bottom, pixels[k + 1]);
  }
  return [Math.max(Math.ceil(right - left), 1), Math.max(Math.ceil(bottom - top), 1), left, top];
}
