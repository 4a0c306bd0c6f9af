// Messages of the wire as plain objects, by the descriptors that the server sends: the page always
// speaks the version of its server, and no code is generated.

import { create, createFileRegistry, fromBinary, toBinary } from "@bufbuild/protobuf";
import { FileDescriptorSetSchema } from "@bufbuild/protobuf/wkt";

const PACKAGE = "covis.v1";

/** Every message, enum and service of the wire. */
export class Descriptors {
  /** Of the bytes of a FileDescriptorSet. */
  constructor(bytes) {
    this.registry = createFileRegistry(fromBinary(FileDescriptorSetSchema, bytes));
  }

  message(name) {
    return this.registry.getMessage(`${PACKAGE}.${name}`);
  }

  /** The method `Method` of `Service`, with the schemas of its request and answer. */
  method(service, method) {
    const found = this.registry.getService(`${PACKAGE}.${service}`);
    return found.methods.find((m) => m.name === method);
  }

  /** The bytes of a message of the given fields. */
  encode(schema, fields) {
    return toBinary(schema, create(schema, fields));
  }

  decode(schema, bytes) {
    return fromBinary(schema, bytes);
  }

  /** The name of an enum's value without the enum's prefix, in lower case with spaces. */
  enumText(name, number) {
    const values = this.registry.getEnum(`${PACKAGE}.${name}`);
    const value = values.values.find((v) => v.number === number);
    const text = value ? value.localName : String(number);
    return text.toLowerCase().replaceAll("_", " ");
  }
}
