// The tab "Closures": what became of each loop closure and why, and what the searches for known places
// have refused.

import { reasonOf, verdictOf } from "../map/closures.js";
import { angleOf, compose, inverse, poseOf } from "../map/geometry.js";
import { idOf } from "../map/slots.js";
import { count, el, replace, table } from "../dom.js";

/** Rows of a table: the newest. */
const MAX_ROWS = 200;
const WORDS = { accepted: "accepted", provisional: "provisional", off: "switched off" };

export class ClosuresPanel {
  constructor(app) {
    this.app = app;
    this.title = "Closures";
    this.searches = [];
    this.searchError = "";
    this.searchRevision = null;
    this.closures = el("div");
    this.refused = el("div");
    this.node = el("div", {}, this.closures, el("h3", {}, "Refused candidates"), this.refused);
  }

  clear() {
    this.searches = [];
    this.searchRevision = null;
  }

  update() {
    const { model } = this.app;
    const rows = [];
    const counts = { accepted: 0, provisional: 0, off: 0 };
    for (const constraint of model.constraints.values()) {
      const verdict = verdictOf(constraint);
      if (!verdict) continue;
      counts[verdict]++;
      rows.push({ verdict, value: constraint.value });
    }
    const summary = Object.entries(WORDS).map(([verdict, word]) =>
      el("span", { className: verdict }, `${count(counts[verdict])} ${word}   `),
    );
    const shown = rows.slice(-MAX_ROWS).reverse().map(({ verdict, value }) => this.#row(verdict, value));
    const columns = [{ name: "Keyframes" }, { name: "Verdict" }, { name: "Off by", number: true }];
    const note = rows.length > shown.length ? `The newest ${MAX_ROWS} of ${count(rows.length)}.` : "";
    replace(
      this.closures,
      el("p", {}, summary),
      rows.length > 0
        ? table("Loop closures", columns, shown)
        : el("p", { className: "note" }, "This map has no loop closures."),
      el("p", { className: "note" }, note),
    );
    this.#showSearches();
  }

  #row(verdict, value) {
    const { keyframeI: i, keyframeJ: j } = value;
    const by = value.id < 0n ? "found by the server" : `sent by ${value.clientId}`;
    const why = value.switchedOff ? reasonOf(value.switchedOff) : by;
    return [
      el("span", {}, this.app.keyframeButton(i.clientId, i.id), " – ", this.app.keyframeButton(j.clientId, j.id)),
      el("span", { className: verdict }, WORDS[verdict], el("small", {}, why)),
      this.#error(value),
    ];
  }

  /** How far the map's poses are from what the closure measured. */
  #error({ keyframeI: i, keyframeJ: j, keyframeIFromKeyframeJ: measured }) {
    const { keyframes } = this.app.model;
    const slots = [i, j].map((ref) => keyframes.get(ref.clientId, idOf(ref.id)));
    if (slots.includes(undefined)) return "–";
    const [a, b] = slots.map((slot) => keyframes.pose.slice(slot * 7, slot * 7 + 7));
    const error = compose(inverse(poseOf(measured)), compose(inverse(a), b));
    const meters = Math.hypot(error[0], error[1], error[2]);
    return `${meters.toFixed(3)} m, ${((angleOf(error) * 180) / Math.PI).toFixed(2)}°`;
  }

  /** Reads the searches again if the map has changed since. */
  async refresh(signal) {
    const { app } = this;
    const revision = app.model.revision;
    if (!app.mapId || this.searchRevision === revision) return;
    const { mapId } = app;
    const searches = [];
    try {
      const take = (message) => void searches.push(...message.searches);
      await app.client.stream("MapService", "ListPlaceSearches", { mapId }, take, signal);
      this.searchError = "";
    } catch (error) {
      this.searchError = error.message;
    }
    if (signal.aborted || app.mapId !== mapId) return;
    this.searchRevision = revision;
    this.searches = searches;
    this.#showSearches();
  }

  #showSearches() {
    const rows = [];
    for (const { keyframe, candidates, refusal } of this.searches) {
      const from = () => this.app.keyframeButton(keyframe.clientId, keyframe.id);
      if (refusal) rows.push([from(), "–", "", `${refusal.reason}: ${refusal.text}`]);
      for (const candidate of candidates.filter((c) => c.refusal)) {
        const { clientId, id } = candidate.keyframe;
        const { reason, text } = candidate.refusal;
        const why = el("span", {}, reason.replaceAll("_", " "), el("small", {}, text));
        const looks = `${candidate.score.toFixed(2)}, ${count(candidate.matchCount)}`;
        rows.push([from(), this.app.keyframeButton(clientId, id), looks, why]);
      }
    }
    const shown = rows.slice(-MAX_ROWS).reverse();
    const columns = [{ name: "Keyframe" }, { name: "Looks like" }, { name: "Score, matches" }, { name: "Why not" }];
    const told = `${count(this.searches.length)} searches for known places, ${count(rows.length)} refusals`;
    replace(
      this.refused,
      this.searchError ? el("p", { className: "error" }, this.searchError) : null,
      shown.length > 0
        ? table(shown.length < rows.length ? `${told}, the newest ${MAX_ROWS}` : told, columns, shown)
        : el("p", { className: "note" }, `${told}.`),
    );
  }
}
