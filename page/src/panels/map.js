// The tab "Map": what a map holds, its clients, and how they are linked.

import { verdictOf } from "../map/closures.js";
import { angleOf, poseOf } from "../map/geometry.js";
import { bytes, count, el, replace, table, terms, time } from "../dom.js";

export class MapPanel {
  constructor(app) {
    this.app = app;
    this.title = "Map";
    this.node = el("div");
  }

  update() {
    const { map, model } = this.app;
    if (!map) {
      replace(this.node, el("p", { className: "note" }, "No map is chosen."));
      return;
    }
    const { counts = {} } = map;
    const rows = [
      ["State", this.app.descriptors.enumText("MapState", model.state || map.state)],
      ["Revision", count(model.revision)],
      ["Keyframes", count(model.keyframes.size)],
      ["Landmarks", count(model.landmarks.size)],
      ["Observations", count(Number(counts.observationCount ?? 0))],
      ["Constraints", count(model.constraints.size)],
      ["Switched off", count(this.#switchedOff())],
      ["Memory", bytes(counts.sizeBytes ?? 0)],
      ["Created", time(map.createTime)],
      ["Changed", time(map.updateTime)],
    ];
    if (map.adjustmentDue) rows.push(["Adjustment", "of the whole map is due"]);
    for (const { mapId, clientIds } of map.mergedMaps ?? []) {
      rows.push([`Merged: ${mapId}`, clientIds.join(", ")]);
    }
    replace(
      this.node,
      el("h2", {}, map.displayName || map.mapId),
      terms(rows),
      this.#clients(map),
      this.#links(),
    );
  }

  #switchedOff() {
    let sum = 0;
    for (const { value } of this.app.model.constraints.values()) if (value.switchedOff) sum++;
    return sum;
  }

  #clients(map) {
    const { model } = this.app;
    const rows = map.clients.map((client) => {
      const frame = model.frames.get(client.clientId)?.mapFromOdom ?? client.mapFromOdom;
      // The frame is in the client's unit of length; an earlier server sends no scale.
      const scale = (model.frames.get(client.clientId) ?? client).scale || 1;
      let drift = "–";
      if (frame) {
        const pose = poseOf(frame);
        const meters = scale * Math.hypot(pose[0], pose[1], pose[2]);
        drift = `${meters.toFixed(3)} m, ${((angleOf(pose) * 180) / Math.PI).toFixed(2)}°`;
        if (scale !== 1) drift += `, scaled by ${scale.toFixed(4)}`;
      }
      const keyframes = model.keyframes.clients.get(client.clientId)?.size ?? 0;
      const sent = count(Number(client.nextSequence) - 1);
      return [client.clientId, count(keyframes), sent, String(client.epoch), drift];
    });
    const columns = [
      { name: "Client" },
      { name: "Keyframes", number: true },
      { name: "Items", number: true },
      { name: "Epoch", number: true },
      { name: "map from odom", number: true },
    ];
    if (rows.length === 0) return el("p", { className: "note" }, "No client has sent anything yet.");
    return table("Clients", columns, rows);
  }

  /** Loop closures by the clients that they join. */
  #links() {
    const links = new Map();
    for (const constraint of this.app.model.constraints.values()) {
      const verdict = verdictOf(constraint);
      if (!verdict) continue;
      const { keyframeI, keyframeJ } = constraint.value;
      const name = [keyframeI.clientId, keyframeJ.clientId].sort().join(" – ");
      const link = links.get(name) ?? { accepted: 0, provisional: 0, off: 0 };
      link[verdict]++;
      links.set(name, link);
    }
    if (links.size === 0) return null;
    const rows = [...links].map(([name, link]) => [
      name, count(link.accepted), count(link.provisional), count(link.off),
    ]);
    const columns = [
      { name: "Clients" },
      { name: "Accepted", number: true },
      { name: "Provisional", number: true },
      { name: "Switched off", number: true },
    ];
    return table("Links: loop closures between and within clients", columns, rows);
  }
}
