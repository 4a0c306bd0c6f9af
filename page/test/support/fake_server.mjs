// Serves the bundle with answers that are made up: for what takes too long to have from a real server,
// such as 20,000 deltas, and for what goes wrong on a wire.

import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { fileURLToPath } from "node:url";

import { DESCRIPTORS, frame, message } from "./wire.mjs";

const TYPES = { "/": "text/html", "/page.js": "text/javascript", "/page.css": "text/css", "/icon.svg": "image/svg+xml" };
const dist = (name) => readFileSync(fileURLToPath(new URL(`../../dist/${name}`, import.meta.url)));

const end = (status, text = "") => frame(Buffer.from(`grpc-status: ${status}\r\ngrpc-message: ${text}\r\n`), 0x80);

/** `answers`: by method, a function that writes messages: `(send, request) => status` or a promise. */
export async function fakeServer(answers) {
  const defaults = {
    ListMaps: (send) => send("ListMapsResponse", { maps: [{ mapId: "hall", uid: "synthetic", state: 1 }] }),
    GetServerInfo: (send) => send("GetServerInfoResponse", { version: "0.0.0", solverThreadCount: 2 }),
  };
  const server = createServer(async (request, response) => {
    const path = request.url;
    if (TYPES[path]) {
      const name = path === "/" ? "index.html" : path.slice(1);
      response.writeHead(200, { "content-type": TYPES[path] }).end(dist(name));
      return;
    }
    if (path === "/descriptors") {
      response.writeHead(200).end(DESCRIPTORS);
      return;
    }
    const method = path.split("/").at(-1);
    const answer = { ...defaults, ...answers }[method];
    for await (const _chunk of request);
    response.writeHead(200, { "content-type": "application/grpc-web+proto" });
    if (!answer) {
      response.end(end(12, "not served"));
      return;
    }
    const write = async (bytes) => {
      if (!response.write(bytes)) await new Promise((resolve) => response.once("drain", resolve));
    };
    const send = (name, fields) => write(typeof name === "string" ? message(name, fields) : frame(name));
    await answer(send);
    response.end(end(0));
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  const close = () => {
    server.closeAllConnections();
    server.close();
  };
  return { url: `http://127.0.0.1:${server.address().port}/`, close };
}
