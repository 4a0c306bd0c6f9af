// gRPC-Web over fetch: one call a request, messages as bytes behind five bytes of flag and length.
//
// The token goes into a header, never into a URL.

import { Frames } from "./frames.js";

/** Codes of gRPC that the page tells apart. */
export const Code = {
  CANCELLED: 1,
  INVALID_ARGUMENT: 3,
  NOT_FOUND: 5,
  PERMISSION_DENIED: 7,
  RESOURCE_EXHAUSTED: 8,
  UNIMPLEMENTED: 12,
  UNAVAILABLE: 14,
  UNAUTHENTICATED: 16,
};

/** How a call ended that did not end well. */
export class RpcError extends Error {
  constructor(code, message) {
    super(message);
    this.name = "RpcError";
    this.code = code;
  }
}

/** Calls the services of a server. */
export class Client {
  /** `token` is asked before each call; it may answer null. */
  constructor(descriptors, token) {
    this.descriptors = descriptors;
    this.token = token;
  }

  /** One answer. */
  async call(service, method, fields = {}, signal = undefined) {
    let answer = null;
    await this.stream(service, method, fields, (message) => (answer = message), signal);
    if (answer === null) throw new RpcError(Code.UNAVAILABLE, "the answer has no message");
    return answer;
  }

  /** Each answer of a stream, decoded; resolves when it has ended well. */
  async stream(service, method, fields, onMessage, signal = undefined) {
    const { output } = this.descriptors.method(service, method);
    const decoded = (bytes) => onMessage(this.descriptors.decode(output, bytes));
    await this.bytes(service, method, fields, decoded, signal);
  }

  /**
   * Each answer of a stream as bytes, which hold until the next one. `onMessage` may return false to
   * end the call.
   */
  async bytes(service, method, fields, onMessage, signal = undefined) {
    const { input } = this.descriptors.method(service, method);
    const message = this.descriptors.encode(input, fields);
    const body = new Uint8Array(5 + message.length);
    new DataView(body.buffer).setUint32(1, message.length);
    body.set(message, 5);
    const headers = { "content-type": "application/grpc-web+proto", "x-grpc-web": "1" };
    const token = this.token();
    if (token) headers.authorization = `Bearer ${token}`;
    let response;
    try {
      const url = `/covis.v1.${service}/${method}`;
      response = await fetch(url, { method: "POST", headers, body, signal, cache: "no-store" });
    } catch (error) {
      throw unreachable(error);
    }
    if (!response.ok) {
      const text = (await response.text()).trim();
      throw new RpcError(Code.UNAVAILABLE, text || `HTTP status ${response.status}`);
    }
    checkStatus(response.headers.get("grpc-status"), response.headers.get("grpc-message"));
    await this.#read(response.body.getReader(), onMessage);
  }

  async #read(reader, onMessage) {
    const frames = new Frames();
    let trailers = null;
    try {
      for (;;) {
        const { done, value } = await reader.read();
        if (done) break;
        frames.push(value);
        for (let frame = frames.next(); frame; frame = frames.next()) {
          if (frame.isTrailers) trailers = parseTrailers(frame.bytes);
          else if (onMessage(frame.bytes) === false) return;
        }
      }
    } catch (error) {
      throw unreachable(error);
    } finally {
      // A call that is left early ends on the server as well.
      reader.cancel().catch(() => {});
    }
    if (!trailers) throw new RpcError(Code.UNAVAILABLE, "the connection broke");
    checkStatus(trailers.get("grpc-status"), trailers.get("grpc-message"));
  }
}

function checkStatus(status, message) {
  const code = Number(status ?? 0);
  if (code === 0) return;
  let text = message ?? "";
  try {
    text = decodeURIComponent(text);
  } catch {
    // It stays as the server sent it.
  }
  throw new RpcError(code, text || `code ${code}`);
}

function parseTrailers(bytes) {
  const lines = new TextDecoder().decode(bytes).split("\r\n");
  const pairs = lines.filter((line) => line.includes(":")).map((line) => {
    const at = line.indexOf(":");
    return [line.slice(0, at).trim().toLowerCase(), line.slice(at + 1).trim()];
  });
  return new Map(pairs);
}

function unreachable(error) {
  if (error instanceof RpcError) return error;
  if (error.name === "AbortError") return new RpcError(Code.CANCELLED, "the call was canceled");
  if (error instanceof TypeError) return new RpcError(Code.UNAVAILABLE, "the server does not answer");
  return error;
}
