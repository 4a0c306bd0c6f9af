// What lies over the 3D view: which layers are shown, how landmarks are colored, and what the colors
// mean. Layers that need more than `WatchMap` brings are fetched when they are asked for, and kept up to
// date as long as they are shown.

import { byId, count, el, say } from "../dom.js";
import { FULL_ERROR_PX, FULL_OBSERVERS, LAYERS } from "./view.js";

const SHADINGS = { observers: "number of observers", error: "reprojection error", plain: "nothing" };
/** See MapPolicy.min_shared_landmark_count. */
const DEFAULT_MIN_SHARED = 15;
/** How often layers follow a map that grows, at most, ms; and at most this share of the time. */
const LEAST_PERIOD_MS = 2000;
const LARGEST_SHARE = 0.1;

export class Overlay {
  constructor(app) {
    this.app = app;
    this.nextAt = 0;
    const { view } = app;
    const checks = Object.entries(LAYERS).map(([layer, text]) => {
      const check = el("input", {
        type: "checkbox",
        checked: view.visible[layer],
        onchange: () => this.#show(layer, check.checked),
      });
      return el("label", { "data-layer": layer }, check, ` ${text}`);
    });
    const options = Object.entries(SHADINGS).map(([value, text]) => el("option", { value }, text));
    this.shading = el("select", { id: "shading", onchange: () => this.#shade() }, options);
    this.note = el("small", { className: "note", role: "status" });
    byId("layers").append(
      ...checks,
      el("label", { htmlFor: "shading" }, "Landmarks by "),
      this.shading,
      el("button", { type: "button", onclick: () => view.fit() }, "Whole map"),
      this.note,
    );
  }

  /** Another map is shown. */
  clear() {
    this.nextAt = 0;
    this.loaded = null;
    this.note.textContent = "";
  }

  #show(layer, isVisible) {
    this.app.view.setVisible(layer, isVisible);
    this.legend();
    this.#now();
  }

  #shade() {
    this.app.view.setShading(this.shading.value);
    this.legend();
    this.#now();
  }

  #now() {
    this.nextAt = 0;
    this.loaded = null;
    this.follow();
  }

  get #wantsObservations() {
    const { view } = this.app;
    return view.visible.covisibility || view.shading === "error";
  }

  /** Brings the layers that need observations or odometry up to date, if it is time. */
  async follow() {
    const { app } = this;
    const { view, observations, model, mapId } = app;
    const wantsAll = this.#wantsObservations;
    if (!mapId || !model.uid || !(wantsAll || view.visible.odometry)) return;
    if (this.isBusy || performance.now() < this.nextAt || this.loaded === model.revision) return;
    this.isBusy = true;
    const begin = performance.now();
    const { signal } = app.watching;
    const { revision } = model;
    try {
      if (wantsAll) {
        await observations.load(mapId, null, signal, (have, all) => {
          this.note.textContent = `Reading observations: ${count(have)} of ${count(all)} keyframes`;
        });
        if (signal.aborted) return;
        this.#compute();
      } else {
        await observations.loadKeyframes(mapId, signal);
        if (signal.aborted) return;
        view.redraw();
      }
      this.note.textContent = "";
      this.loaded = revision;
    } catch (error) {
      if (!signal.aborted) this.note.textContent = error.message;
    } finally {
      this.isBusy = false;
      const took = performance.now() - begin;
      this.nextAt = performance.now() + Math.max(LEAST_PERIOD_MS, took / LARGEST_SHARE);
      setTimeout(() => this.follow(), this.nextAt - performance.now() + 1);
    }
  }

  #compute() {
    const { view, observations, map } = this.app;
    if (view.shading === "error") {
      view.setShading("error", observations.errors());
    }
    if (view.visible.covisibility) {
      const least = map?.policy?.minSharedLandmarkCount ?? DEFAULT_MIN_SHARED;
      const edges = observations.covisibility(least);
      view.setEdges(edges);
      say(`${count(edges.length)} pairs of keyframes share ${least} landmarks or more`);
    }
  }

  /** Says what the colors mean. */
  legend() {
    const { view } = this.app;
    const css = (color) => `rgb(${color.join(" ")})`;
    const swatch = (color) => {
      const node = el("i");
      node.style.background = css(color);
      return node;
    };
    const key = (color, text) => el("div", { className: "key" }, swatch(color), text);
    const parts = [];
    if (view.visible.landmarks && view.shading !== "plain") {
      const ramp = el("div", { className: "ramp", "aria-hidden": "true" }, view.palette.ramp.map((color) => {
        const node = el("span");
        node.style.background = css(color);
        return node;
      }));
      const isError = view.shading === "error";
      const [low, high] = isError ? ["0 px", `${FULL_ERROR_PX} px`] : ["1", `${FULL_OBSERVERS} or more`];
      const title = isError ? "Landmarks: reprojection error, RMS" : "Landmarks: observers";
      parts.push(title, ramp, el("div", { className: "scale" }, el("span", {}, low), el("span", {}, high)));
    }
    if (view.visible.closures) {
      parts.push(key(view.palette.accepted, "closure, accepted"));
      parts.push(key(view.palette.provisional, "closure, provisional"));
      parts.push(key(view.palette.off, "closure, switched off"));
    }
    if (view.visible.window) parts.push(key(view.palette.window, "moved by the last correction"));
    if (view.visible.odometry) parts.push(key(view.palette.odometry, "odometry alone"));
    byId("legend").replaceChildren(...parts);
  }
}
