// Cuts a stream of bytes into the frames of gRPC-Web. One buffer, which grows to the largest frame and
// is used again.

const HEADER_BYTES = 5;
const TRAILERS = 0x80;

export class Frames {
  constructor() {
    this.buffer = new Uint8Array(1 << 16);
    this.start = 0;
    this.end = 0;
  }

  /** Adds bytes that have arrived. */
  push(bytes) {
    const held = this.end - this.start;
    if (this.end + bytes.length > this.buffer.length) {
      const needed = held + bytes.length;
      let size = this.buffer.length;
      while (size < needed) size *= 2;
      const target = size === this.buffer.length ? this.buffer : new Uint8Array(size);
      target.set(this.buffer.subarray(this.start, this.end));
      this.buffer = target;
      this.start = 0;
      this.end = held;
    }
    this.buffer.set(bytes, this.end);
    this.end += bytes.length;
  }

  /** The next whole frame, or null. Its bytes hold until the next `push`. */
  next() {
    if (this.end - this.start < HEADER_BYTES) return null;
    const b = this.buffer;
    const s = this.start;
    const length = ((b[s + 1] << 24) | (b[s + 2] << 16) | (b[s + 3] << 8) | b[s + 4]) >>> 0;
    if (this.end - s < HEADER_BYTES + length) return null;
    this.start = s + HEADER_BYTES + length;
    const bytes = b.subarray(s + HEADER_BYTES, this.start);
    return { isTrailers: (b[s] & TRAILERS) !== 0, bytes };
  }
}
