// Messages of the wire for tests, by the descriptors in the repository.

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";

import { Descriptors } from "../../src/wire/descriptors.js";

const path = new URL("../../../client/src/wire/generated/covis.v1.bin", import.meta.url);
export const DESCRIPTORS = readFileSync(fileURLToPath(path));
export const wire = new Descriptors(DESCRIPTORS);

/** The bytes of a message behind flag and length, as gRPC and gRPC-Web frame it. */
export function frame(bytes, flag = 0) {
  const framed = Buffer.alloc(5 + bytes.length);
  framed[0] = flag;
  framed.writeUInt32BE(bytes.length, 1);
  framed.set(bytes, 5);
  return framed;
}

/** A framed message of the given type and fields. */
export const message = (name, fields) => frame(wire.encode(wire.message(name), fields));
