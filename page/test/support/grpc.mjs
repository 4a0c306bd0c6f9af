// gRPC from Node over HTTP/2, as a robot calls the server: unary calls and the stream Ingest.

import { connect } from "node:http2";

import { frame, wire } from "./wire.mjs";

// Values of AckStatus.
const RECEIVED = 1;
const OPTIMIZED = 3;
const REJECTED = 4;

export class Grpc {
  constructor(url, token = null) {
    this.session = connect(url);
    this.session.on("error", () => {});
    this.token = token;
  }

  #open(service, method) {
    const headers = {
      ":method": "POST", ":path": `/covis.v1.${service}/${method}`,
      "content-type": "application/grpc+proto", te: "trailers",
    };
    if (this.token) headers.authorization = `Bearer ${this.token}`;
    const stream = this.session.request(headers);
    const { input, output } = wire.method(service, method);
    const state = { status: null, text: "" };
    const read = (found) => {
      if (found["grpc-status"] === undefined) return;
      state.status = Number(found["grpc-status"]);
      state.text = decodeURIComponent(found["grpc-message"] ?? "");
    };
    stream.on("response", read);
    stream.on("trailers", read);
    let held = Buffer.alloc(0);
    const onMessage = (take) => {
      stream.on("data", (chunk) => {
        held = Buffer.concat([held, chunk]);
        while (held.length >= 5 && held.length >= 5 + held.readUInt32BE(1)) {
          const end = 5 + held.readUInt32BE(1);
          take(wire.decode(output, held.subarray(5, end)));
          held = held.subarray(end);
        }
      });
    };
    const send = (fields) => stream.write(frame(wire.encode(input, fields)));
    const ended = new Promise((resolve, reject) => {
      stream.on("close", () => {
        if (state.status === 0) resolve();
        else reject(new Error(`${service}/${method}: code ${state.status}: ${state.text}`));
      });
      stream.on("error", reject);
    });
    ended.catch(() => {});
    return { stream, send, onMessage, ended };
  }

  /** The answers of a call with one request. */
  async call(service, method, fields = {}) {
    const { stream, send, onMessage, ended } = this.#open(service, method);
    const answers = [];
    onMessage((answer) => answers.push(answer));
    send(fields);
    stream.end();
    await ended;
    return answers.at(-1);
  }

  /** An ingest stream of a client. `item(kind, value)` resolves with the ack that took it. */
  async ingest(mapId, clientId) {
    const { stream, send, onMessage, ended } = this.#open("IngestService", "Ingest");
    const waiting = new Map();
    const solved = [];
    let open;
    const opened = new Promise((resolve, reject) => {
      open = resolve;
      ended.catch(reject);
    });
    onMessage(({ event: { case: kind, value } }) => {
      if (kind === "opened") open(value);
      else if (value.status === RECEIVED || value.status === REJECTED) {
        const { resolve, reject } = waiting.get(value.sequence);
        waiting.delete(value.sequence);
        const why = value.violations.map((v) => `${v.field}: ${v.description}`).join("; ");
        if (value.status === RECEIVED) resolve(value);
        else reject(new Error(`refused: ${why}`));
      } else if (value.status === OPTIMIZED) {
        for (const wait of solved.splice(0)) {
          if (wait.sequence <= value.sequence) wait.resolve(value);
          else solved.push(wait);
        }
      }
    });
    send({ item: { case: "open", value: { mapId, clientId } } });
    let { nextSequence: next } = await opened;
    return {
      close: () => stream.end(),
      item: (kind, value) => {
        const sequence = next++;
        const taken = new Promise((resolve, reject) => {
          waiting.set(sequence, { resolve, reject });
          ended.then(() => reject(new Error("the stream ended")), reject);
        });
        taken.catch(() => {});
        send({ sequence, item: { case: kind, value } });
        return taken;
      },
      /** Resolves when solves have covered an item that was taken. */
      optimized: ({ sequence }) => new Promise((resolve) => solved.push({ sequence, resolve })),
    };
  }

  close() {
    this.session.close();
  }
}
