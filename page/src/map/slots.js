// Entities in typed arrays: an id has a slot, a slot has a place in each array. Arrays double when they
// are full; slots of what is gone are used again, so that a map at rest takes no further memory.

/** An id of a message, as slots have it: a number where that is exact. */
export function idOf(value) {
  const number = Number(value);
  return Number.isSafeInteger(number) ? number : BigInt(value);
}

export class Slots {
  /** `columns` names arrays: their type, and how many numbers a slot has. */
  constructor(columns) {
    this.columns = columns;
    this.capacity = 0;
    /** How many slots were ever used: those that are free are among them. */
    this.count = 0;
    this.free = [];
    this.bySlot = [];
    this.clients = new Map();
    this.#grow(1024);
  }

  get size() {
    return this.count - this.free.length;
  }

  #grow(capacity) {
    for (const [name, { type, width }] of Object.entries(this.columns)) {
      const grown = new type(capacity * width);
      if (this[name]) grown.set(this[name]);
      this[name] = grown;
    }
    this.capacity = capacity;
  }

  #ids(client) {
    let ids = this.clients.get(client);
    if (!ids) this.clients.set(client, (ids = new Map()));
    return ids;
  }

  /** The slot of an entity, or undefined. */
  get(client, id) {
    return this.clients.get(client)?.get(id);
  }

  /** The slot of an entity, which gets one if it has none. Then `isNew` is true. */
  put(client, id) {
    const ids = this.#ids(client);
    let slot = ids.get(id);
    this.isNew = slot === undefined;
    if (this.isNew) {
      slot = this.free.length > 0 ? this.free.pop() : this.count++;
      if (slot >= this.capacity) this.#grow(this.capacity * 2);
      ids.set(id, slot);
      this.bySlot[slot] = { client, id };
    }
    return slot;
  }

  /** Frees the slot of an entity; answers it, or undefined if there is none. */
  remove(client, id) {
    const ids = this.clients.get(client);
    const slot = ids?.get(id);
    if (slot === undefined) return undefined;
    ids.delete(id);
    if (ids.size === 0) this.clients.delete(client);
    this.bySlot[slot] = null;
    this.free.push(slot);
    return slot;
  }

  /** The client and id of a slot, or null. */
  owner(slot) {
    return this.bySlot[slot] ?? null;
  }

  clear() {
    this.count = 0;
    this.free.length = 0;
    this.bySlot.length = 0;
    this.clients.clear();
  }

  /** Bytes of all arrays. */
  get bytes() {
    return Object.keys(this.columns).reduce((sum, name) => sum + this[name].byteLength, 0);
  }
}
