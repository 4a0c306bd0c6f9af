// The page: which map is shown, the stream that keeps it up to date, and the parts that show it.

import "uplot/dist/uPlot.min.css";
import "./style.css";

import { byId, count, el, replace, say } from "./dom.js";
import { MapModel } from "./map/model.js";
import { Observations } from "./map/observations.js";
import { idOf } from "./map/slots.js";
import { ClosuresPanel } from "./panels/closures.js";
import { JobsPanel } from "./panels/jobs.js";
import { KeyframePanel } from "./panels/keyframe.js";
import { MapPanel } from "./panels/map.js";
import { MetricsPanel } from "./panels/metrics.js";
import { Tabs } from "./panels/tabs.js";
import { Overlay } from "./scene/overlay.js";
import { MapView } from "./scene/view.js";
import { Token } from "./token.js";
import { Descriptors } from "./wire/descriptors.js";
import { Client, Code } from "./wire/rpc.js";

const MAPS_PERIOD_MS = 2000;
const PANEL_PERIOD_MS = 250;
/** How soon the tab that is shown asks the server again. */
const REFRESH_MS = 1000;
const FIRST_RETRY_MS = 250;
const LONGEST_RETRY_MS = 8000;

class App {
  constructor(descriptors) {
    this.descriptors = descriptors;
    this.token = new Token(() => this.restart());
    this.client = new Client(descriptors, () => this.token.value);
    this.model = new MapModel((name, bytes) => descriptors.decode(descriptors.message(name), bytes));
    this.observations = new Observations(this.client, this.model);
    this.maps = [];
    this.map = null;
    this.mapId = null;
    this.watching = new AbortController();
    this.panels = {
      map: new MapPanel(this),
      closures: new ClosuresPanel(this),
      keyframe: new KeyframePanel(this),
      jobs: new JobsPanel(this),
      metrics: new MetricsPanel(this),
    };
    this.view = new MapView(byId("view"), this.model, this.observations);
    this.overlay = new Overlay(this);
    this.view.onPick = (slot) => {
      const { client, id } = this.model.keyframes.owner(slot);
      this.chooseKeyframe(client, id);
    };
    this.view.onFrame = () => this.#tellCounts();
    this.tabs = new Tabs(this.panels, (name) => this.#showTab(name));
    this.#initTheme();
  }

  /** Reads everything that can be read anew, for instance with another token. */
  async restart() {
    this.#leaveMap();
    clearTimeout(this.mapsTimer);
    clearTimeout(this.refreshTimer);
    await this.#readMaps();
    this.#refresh();
  }

  // Maps.

  async #readMaps() {
    clearTimeout(this.mapsTimer);
    try {
      const maps = [];
      let pageToken = "";
      do {
        const fields = { pageSize: 1000, pageToken };
        const page = await this.client.call("MapService", "ListMaps", fields);
        maps.push(...page.maps);
        pageToken = page.nextPageToken;
      } while (pageToken !== "");
      await this.#readServer();
      this.#takeMaps(maps);
    } catch (error) {
      if (this.report(error)) return;
    }
    this.mapsTimer = setTimeout(() => this.#readMaps(), MAPS_PERIOD_MS);
  }

  async #readServer() {
    const info = await this.client.call("ServerService", "GetServerInfo");
    byId("server").textContent = `version ${info.version}, ${info.solverThreadCount} solver threads`;
    this.token.accepted();
  }

  #takeMaps(maps) {
    this.maps = maps;
    const items = maps.map((map) => {
      const { keyframeCount = 0n, landmarkCount = 0n } = map.counts ?? {};
      const counts = `${count(Number(keyframeCount))} keyframes, ${count(Number(landmarkCount))} landmarks`;
      return el("li", {}, el("button", {
        type: "button",
        "data-key": map.mapId,
        "aria-current": String(map.mapId === this.mapId),
        onclick: () => this.chooseMap(map.mapId),
      }, map.mapId, el("small", {}, counts)));
    });
    replace(byId("maps"), items);
    byId("maps-note").textContent = maps.length === 0 ? "This server has no maps yet." : "";
    this.map = maps.find((map) => map.mapId === this.mapId) ?? null;
    if (!this.mapId && maps.length > 0) {
      const newest = maps.reduce((a, b) => ((b.updateTime?.seconds ?? 0n) > (a.updateTime?.seconds ?? 0n) ? b : a));
      this.chooseMap(newest.mapId);
    } else if (!this.mapId) this.#connection("live", "Connected");
    this.#updatePanels();
  }

  /** Shows a map. */
  chooseMap(mapId) {
    if (mapId === this.mapId) return;
    this.#leaveMap();
    this.mapId = mapId;
    this.#takeMaps(this.maps);
    say(`Map ${mapId}`);
    this.#watch(mapId, this.watching.signal);
  }

  #leaveMap() {
    this.watching.abort();
    this.watching = new AbortController();
    this.mapId = null;
    this.map = null;
    this.model.clear();
    this.observations.reset();
    this.view.clear();
    this.overlay.clear();
    for (const panel of Object.values(this.panels)) panel.clear?.();
  }

  /** Keeps the model up to date until the map is left. */
  async #watch(mapId, signal) {
    let wait = FIRST_RETRY_MS;
    while (!signal.aborted) {
      try {
        this.model.parts.length = 0;
        const { uid, revision } = this.model;
        const from = uid ? { fromRevision: BigInt(revision), mapUid: uid } : {};
        this.#connection("waiting", uid ? "Connecting again …" : "Connecting …");
        await this.client.bytes("MapService", "WatchMap", { mapId, ...from }, (bytes) => {
          if (!this.model.apply(bytes)) return;
          wait = FIRST_RETRY_MS;
          // A map that was made anew under the same name has other observations.
          if (uid && uid !== this.model.uid) this.observations.reset();
          this.#connection("live", "Live");
          this.#changed();
        }, signal);
      } catch (error) {
        if (signal.aborted) return;
        if (error.code === Code.NOT_FOUND) {
          this.#leaveMap();
          this.#connection("live", `Map ${mapId} is gone`);
          return;
        }
        // A copy that does not fit what the server says begins anew.
        if (error.code === undefined) this.model.clear();
        if (this.report(error)) return;
      }
      await new Promise((resolve) => setTimeout(resolve, wait));
      wait = Math.min(wait * 2, LONGEST_RETRY_MS);
    }
  }

  #changed() {
    this.view.invalidate();
    this.#updatePanels();
  }

  /** Panels follow a map that changes often at their own pace. */
  #updatePanels() {
    if (this.panelTimer) return;
    this.panelTimer = setTimeout(() => {
      this.panelTimer = null;
      const shown = this.panels[this.tabs.shown];
      shown.update();
      this.overlay.follow();
    }, PANEL_PERIOD_MS);
  }

  #showTab(name) {
    if (!this.tabs) return;
    this.panels[name].update();
    if (name === "metrics") this.panels.metrics.draw();
    this.#refresh();
  }

  /** What the tab that is shown asks the server for. */
  async #refresh() {
    clearTimeout(this.refreshTimer);
    const round = (this.round = (this.round ?? 0) + 1);
    if (!document.hidden && !this.token.isAsked) {
      this.panels.metrics.sample();
      await this.panels[this.tabs.shown].refresh?.(this.watching.signal);
    }
    if (round !== this.round) return;
    this.refreshTimer = setTimeout(() => this.#refresh(), REFRESH_MS);
  }

  // Keyframes.

  chooseKeyframe(client, id) {
    this.view.select({ client, id });
    this.tabs.show("keyframe");
    this.choosing?.abort();
    this.choosing = new AbortController();
    const signal = AbortSignal.any([this.choosing.signal, this.watching.signal]);
    this.panels.keyframe.choose(client, id, signal);
  }

  /** A button that shows a keyframe. */
  keyframeButton(client, id) {
    const name = `${client}/${id}`;
    const choose = () => this.chooseKeyframe(client, idOf(id));
    return el("button", { type: "button", className: "link", "aria-label": `Keyframe ${name}`, onclick: choose }, name);
  }

  // What is said.

  /** Tells of an error; answers whether nothing is tried again until a token is given. */
  report(error) {
    if (error.code === Code.UNAUTHENTICATED || error.code === Code.PERMISSION_DENIED) {
      this.#connection("failed", "Not admitted");
      this.token.ask(error.message);
      return error.code === Code.UNAUTHENTICATED;
    }
    this.#connection("failed", error.message);
    return false;
  }

  #connection(state, text) {
    const node = byId("connection");
    if (node.dataset.state === state && node.textContent === text) return;
    node.dataset.state = state;
    node.textContent = text;
  }

  #tellCounts() {
    const { keyframes, landmarks, revision, uid } = this.model;
    const text = uid
      ? `${count(keyframes.size)} keyframes, ${count(landmarks.size)} landmarks, revision ${count(revision)}`
      : "";
    const node = byId("counts");
    if (node.textContent !== text) node.textContent = text;
    let hint = "";
    if (this.mapId && uid && keyframes.size === 0 && landmarks.size === 0) hint = "This map is empty.";
    byId("empty").textContent = hint;
  }

  #initTheme() {
    const asked = matchMedia("(prefers-color-scheme: light)");
    let own = null;
    const apply = () => {
      const theme = own ?? (asked.matches ? "light" : "dark");
      document.documentElement.dataset.theme = theme;
      byId("theme").textContent = theme === "light" ? "Dark" : "Light";
      this.view.setTheme(theme);
      this.overlay.legend();
      this.panels.metrics.setTheme();
      this.panels.keyframe.update();
    };
    asked.addEventListener("change", apply);
    byId("theme").addEventListener("click", () => {
      own = document.documentElement.dataset.theme === "light" ? "dark" : "light";
      apply();
    });
    apply();
  }
}

const response = await fetch("/descriptors");
const app = new App(new Descriptors(new Uint8Array(await response.arrayBuffer())));
// For measurements, and for whoever looks closer with the browser's tools.
globalThis.covis = app;
await app.restart();
