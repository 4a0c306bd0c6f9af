// Reads the binary form of messages field by field, for those of which there are very many: nothing is
// made of a message but the numbers that are asked for.

const decoder = new TextDecoder();

export class Reader {
  /** Reads `bytes`, which must not change meanwhile. */
  constructor(bytes) {
    this.use(bytes);
    // Names of clients repeat: the last ones are kept, so that most make no new string.
    this.names = [];
  }

  /** Reads other bytes. */
  use(bytes) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.at = 0;
    this.end = bytes.length;
  }

  /** The next tag: the field's number shifted by three, and its wire type below. */
  tag() {
    return this.uint();
  }

  /** A varint that fits 32 bits, like a tag or a length. */
  uint() {
    const { bytes } = this;
    let byte = bytes[this.at++];
    if (byte < 0x80) return byte;
    let value = byte & 0x7f;
    let scale = 128;
    do {
      byte = bytes[this.at++];
      value += (byte & 0x7f) * scale;
      scale *= 128;
    } while (byte >= 0x80);
    return value;
  }

  /** An int64: a number where that is exact, else a bigint. */
  int64() {
    const { bytes } = this;
    let low = 0;
    let scale = 1;
    for (let count = 0; count < 7; count++) {
      const byte = bytes[this.at++];
      low += (byte & 0x7f) * scale;
      if (!(byte >= 0x80)) return low;
      scale *= 128;
    }
    // 49 bits are read.
    let value = BigInt(low);
    let shift = 49n;
    for (;;) {
      const byte = bytes[this.at++];
      value |= BigInt(byte & 0x7f) << shift;
      if (!(byte >= 0x80)) break;
      shift += 7n;
    }
    value = BigInt.asIntN(64, value);
    const number = Number(value);
    return Number.isSafeInteger(number) ? number : value;
  }

  double() {
    const value = this.view.getFloat64(this.at, true);
    this.at += 8;
    return value;
  }

  bool() {
    return this.uint() !== 0;
  }

  /** Where the message that begins here ends. */
  message() {
    const length = this.uint();
    const end = this.at + length;
    if (!(end <= this.end)) throw new Error("a message is cut off");
    return end;
  }

  /** Bytes, as a view. */
  raw() {
    const end = this.message();
    const bytes = this.bytes.subarray(this.at, end);
    this.at = end;
    return bytes;
  }

  /** A short text that repeats. */
  name() {
    const end = this.message();
    const { bytes, at } = this;
    const length = end - at;
    this.at = end;
    for (const known of this.names) {
      if (known.bytes.length !== length) continue;
      let k = 0;
      while (k < length && known.bytes[k] === bytes[at + k]) k++;
      if (k === length) return known.text;
    }
    const own = bytes.slice(at, at + length);
    const text = decoder.decode(own);
    if (this.names.length < 64) this.names.push({ bytes: own, text });
    return text;
  }

  /** Passes over a field of this tag. */
  skip(tag) {
    switch (tag & 7) {
      case 0:
        while (this.bytes[this.at++] >= 0x80);
        break;
      case 1:
        this.at += 8;
        break;
      case 2:
        this.at = this.message();
        break;
      case 5:
        this.at += 4;
        break;
      default:
        throw new Error(`a message has wire type ${tag & 7}`);
    }
    if (this.at > this.end) throw new Error("a message is cut off");
  }
}
