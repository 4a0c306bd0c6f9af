// The tab "Metrics": the server's metrics over time, for a token that may see them, and what the page
// itself sees of the map.

import uPlot from "uplot";

import { bytes, count, el } from "../dom.js";

/** Samples that are kept: ten minutes. */
const KEPT = 300;
const PERIOD_MS = 2000;

/** Rates and means between two samples of counters. */
const rate = (name, labels) => (now, before, seconds) => difference(now, before, name, labels) / seconds;
const mean = (name) => (now, before) => {
  const events = difference(now, before, `${name}_count`);
  return events > 0 ? (1000 * difference(now, before, `${name}_sum`)) / events : null;
};
const difference = (now, before, name, labels) => sum(now, name, labels) - sum(before, name, labels);
const whole = (value) => count(Math.round(value));
const number = (value) => (value >= 100 ? count(Math.round(value)) : value.toFixed(value >= 10 ? 1 : 2));

const CHARTS = [
  { title: "Keyframes", unit: whole, lines: { all: ({ model }) => model.keyframes.size } },
  { title: "Landmarks", unit: whole, lines: { all: ({ model }) => model.landmarks.size } },
  {
    title: "Corrections of the newest keyframe, m",
    unit: (meters) => (meters > 0 ? meters.toPrecision(3) : "0"),
    lines: { largest: ({ model }) => model.takeShift() },
  },
  {
    title: "Items a second",
    unit: number,
    metrics: {
      received: rate("covis_items_total", { outcome: "received" }),
      rejected: rate("covis_items_total", { outcome: "rejected" }),
    },
  },
  {
    title: "From an item's arrival, ms",
    unit: number,
    metrics: { durable: mean("covis_item_durable_seconds"), optimized: mean("covis_item_optimized_seconds") },
  },
  {
    title: "Solves a second",
    unit: number,
    metrics: { ended: rate("covis_solves_total"), superseded: rate("covis_solves_superseded_total") },
  },
  {
    title: "Time of a solve, ms",
    unit: number,
    metrics: { ran: mean("covis_solve_duration_seconds"), waited: mean("covis_solve_wait_seconds") },
  },
  {
    title: "Memory",
    unit: bytes,
    metrics: {
      process: (now) => sum(now, "covis_resident_memory_bytes") || null,
      maps: (now) => sum(now, "covis_resource_held", { resource: "map_bytes" }),
    },
  },
];

export class MetricsPanel {
  constructor(app) {
    this.app = app;
    this.title = "Metrics";
    this.note = el("p", { className: "note" });
    this.charts = CHARTS.map((chart) => this.#chart(chart));
    this.resources = el("div");
    this.node = el("div", {}, this.note, this.charts.map(({ figure }) => figure), this.resources);
    this.times = [];
    this.last = null;
  }

  #chart(chart) {
    const names = Object.keys(chart.metrics ?? chart.lines);
    const values = names.map(() => el("b"));
    const keys = names.map((name, k) => el("span", { className: `line-${k}` }, `${name} `, values[k]));
    const latest = el("span", {}, keys);
    const place = el("div", { "aria-hidden": "true" });
    const figure = el("figure", { hidden: true }, el("figcaption", {}, chart.title, latest), place);
    const lines = names.map(() => []);
    return { ...chart, names, latest: values, place, figure, values: lines, plot: null };
  }

  update() {}

  /** Forgets what belongs to another map. */
  clear() {
    this.times.length = 0;
    this.last = null;
    for (const { values } of this.charts) for (const line of values) line.length = 0;
  }

  /** Called often; samples every two seconds whether the tab is shown or not. */
  async sample() {
    const now = performance.now();
    if (this.isSampling || (this.last && now - this.last.at < PERIOD_MS - 50)) return;
    this.isSampling = true;
    try {
      const metrics = await this.#read();
      const seconds = this.last ? (now - this.last.at) / 1000 : 0;
      const before = this.last?.metrics;
      this.last = { at: now, metrics };
      this.times.push(Date.now() / 1000);
      if (this.times.length > KEPT) this.times.shift();
      for (const chart of this.charts) this.#add(chart, metrics, before, seconds);
      if (!this.node.hidden) this.draw();
    } finally {
      this.isSampling = false;
    }
  }

  async #read() {
    const token = this.app.client.token();
    // What was refused once is not asked for again: the server keeps a record of refusals.
    if (this.refused !== undefined && this.refused === token) return null;
    const headers = token ? { authorization: `Bearer ${token}` } : {};
    try {
      const response = await fetch("/metrics", { headers, cache: "no-store" });
      // The guard answers as it does to a call.
      const isRefused = Number(response.headers.get("grpc-status") ?? 0) !== 0;
      this.refused = isRefused ? token : undefined;
      this.note.textContent = isRefused
        ? "The server's own metrics are of all tenants: they need a token of an administrator."
        : "";
      return response.ok && !isRefused ? parse(await response.text()) : null;
    } catch {
      return null;
    }
  }

  #add({ metrics: ofServer, lines, names, values }, metrics, before, seconds) {
    names.forEach((name, k) => {
      let value = null;
      if (lines) value = lines[name](this.app);
      else if (metrics && before && seconds > 0) value = ofServer[name](metrics, before, seconds);
      values[k].push(value);
      if (values[k].length > KEPT) values[k].shift();
    });
  }

  /** Draws the samples; called when the tab is shown, and for each sample while it is. */
  draw() {
    for (const chart of this.charts) {
      const { names, values, unit } = chart;
      chart.figure.hidden = !values.some((line) => line.some((value) => value !== null));
      if (chart.figure.hidden) continue;
      names.forEach((_name, k) => {
        const now = values[k].findLast((value) => value !== null);
        chart.latest[k].textContent = now === undefined ? "–" : unit(now);
      });
      // One sample has no time axis yet.
      if (this.times.length < 2) continue;
      const data = [this.times, ...values];
      if (chart.plot) chart.plot.setData(data);
      else chart.plot = this.#plot(chart, data);
    }
  }

  #plot({ names, unit, place }, data) {
    const style = getComputedStyle(document.documentElement);
    const color = (name) => style.getPropertyValue(name).trim();
    const axis = { stroke: color("--quiet"), grid: { stroke: color("--line"), width: 1 }, ticks: { show: false } };
    const tints = [color("--line-0"), color("--line-1")];
    const options = {
      width: Math.max(this.node.clientWidth - 4, 200),
      height: 110,
      legend: { show: false },
      cursor: { show: false },
      axes: [{ ...axis, size: 22, values: clock }, { ...axis, size: 62, values: (_plot, ticks) => ticks.map(unit) }],
      scales: { y: { range: (_plot, low, high) => [Math.min(low ?? 0, 0), high > 0 ? high * 1.1 : 4] } },
      series: [{}, ...names.map((name, k) => ({ label: name, stroke: tints[k], width: 1.5, spanGaps: true }))],
    };
    return new uPlot(options, data, place);
  }

  /** Has the charts made anew, in the colors of the theme. */
  setTheme() {
    for (const chart of this.charts) {
      chart.plot?.destroy();
      chart.plot = null;
    }
    if (!this.node.hidden) this.draw();
  }
}

/** Times below a chart. */
const clock = (_plot, ticks) => ticks.map((tick) => new Date(tick * 1000).toLocaleTimeString("en-GB"));

/** The rows of the text format of Prometheus. */
function parse(text) {
  const rows = new Map();
  for (const line of text.split("\n")) {
    if (line === "" || line.startsWith("#")) continue;
    const at = line.lastIndexOf(" ");
    const name = line.slice(0, at);
    const brace = name.indexOf("{");
    const family = brace < 0 ? name : name.slice(0, brace);
    const labels = brace < 0 ? "" : name.slice(brace);
    if (!rows.has(family)) rows.set(family, []);
    rows.get(family).push({ labels, value: Number(line.slice(at + 1)) });
  }
  return rows;
}

/** The sum of a family's rows that have these labels. */
function sum(rows, family, labels = {}) {
  const wanted = Object.entries(labels).map(([name, value]) => `${name}="${value}"`);
  const found = (rows.get(family) ?? []).filter((row) => wanted.every((label) => row.labels.includes(label)));
  return found.reduce((total, { value }) => total + value, 0);
}
