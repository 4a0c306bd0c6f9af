// A large map and a long stream, from a server that makes them up: what the page takes to show them, and
// that it holds no more after 20,000 deltas than before.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { executable, launch, open, orbit, spin, until } from "./support/browser.mjs";
import { fakeServer } from "./support/fake_server.mjs";
import { keyframePose, landmark, landmarkMessage, pose, random, wholeMap } from "./support/synthetic.mjs";
import { wire } from "./support/wire.mjs";

const skip = !executable && "skipped: no chromium";
const KEYFRAMES = 1000;
const LANDMARKS = 100_000;
const DELTAS = 20_000;

let browser;
before(async () => {
  if (!skip) browser = await launch();
});
after(() => browser?.close());

const encode = (delta) => Buffer.from(wire.encode(wire.message("WatchMapResponse"), { delta }));
const encodeDelta = (fields) => wire.encode(wire.message("MapDelta"), fields);

/** A WatchMapResponse of the bytes of a delta, which may come in pieces. */
function response(...pieces) {
  const delta = Buffer.concat(pieces);
  const head = [10];
  let size = delta.length;
  for (; size >= 128; size = Math.floor(size / 128)) head.push((size % 128) | 128);
  return Buffer.concat([Buffer.from([...head, size]), delta]);
}

test("a large map is there soon and is turned smoothly", { skip }, async (t) => {
  const whole = encode({ ...wholeMap(KEYFRAMES, LANDMARKS), revision: 1000n });
  let leave;
  const left = new Promise((resolve) => (leave = resolve));
  const server = await fakeServer({
    WatchMap: async (send) => {
      await send(whole);
      await left;
    },
  });
  const { page, errors, close } = await open(browser, server.url);
  await until(page, (count) => globalThis.covis?.view.points.count === count, LANDMARKS);
  const seen = await page.evaluate(() => ({
    paint: performance.getEntriesByName("first-contentful-paint")[0].startTime,
    map: performance.now(),
  }));
  t.diagnostic(`first paint ${seen.paint.toFixed(0)} ms, the whole map within ${seen.map.toFixed(0)} ms`);
  await orbit(page, 1500);
  const rate = await orbit(page, 3000);
  const most = await spin(page, 3000);
  const share = await page.evaluate(() => globalThis.covis.view.share);
  t.diagnostic(`${rate.toFixed(0)} frames a second, ${(100 * share).toFixed(0)} % of the landmarks while a mouse turns it`);
  t.diagnostic(`${most.toFixed(0)} frames a second while it turns in each frame`);
  assert.ok(rate > 5, `${rate} frames a second`);
  // At rest all of them are drawn.
  await until(page, () => {
    const { range, count } = { range: globalThis.covis.view.points.object.geometry, count: globalThis.covis.view.points.count };
    return range.index === null && range.drawRange.count === count;
  });
  assert.deepEqual(errors, []);
  await close();
  leave();
  server.close();
});

test("20,000 deltas leave heap and buffers as they were", { skip }, async (t) => {
  const whole = encode({ ...wholeMap(200, 20_000), revision: 1n });
  const next = random(3);
  // A local solve's correction: 10 keyframes and 100 landmarks; a hundred different ones, again and again.
  const corrections = Array.from({ length: 100 }, (_, k) => ({
    lastPart: true,
    state: 1,
    mapUid: "synthetic",
    keyframes: Array.from({ length: 10 }, (_, j) => keyframePose((2 * k + j) % 200, pose((2 * k + j) % 200, 200))),
    landmarks: Array.from({ length: 100 }, (_, j) => landmarkMessage((200 * k + j) % 20_000, landmark(next), 3)),
  })).map(encodeDelta);
  const held = [];
  let go;
  const started = new Promise((resolve) => (go = resolve));
  let leave;
  const left = new Promise((resolve) => (leave = resolve));
  const half = { reached: null };
  half.wait = new Promise((resolve) => (half.reached = resolve));
  const server = await fakeServer({
    WatchMap: async (send) => {
      await send(whole);
      await started;
      for (let k = 0; k < DELTAS; k++) {
        if (k === DELTAS / 2) await half.wait;
        const revision = BigInt(k + 1);
        const head = encodeDelta({ baseRevision: revision, revision: revision + 1n });
        await send(response(head, corrections[k % 100]));
      }
      await left;
    },
  });
  const { page, errors, close } = await open(browser, server.url);
  const measure = () =>
    page.evaluate(async () => {
      // What ends with a task is garbage in the next one.
      for (let round = 0; round < 3; round++) {
        globalThis.gc();
        await new Promise((resolve) => setTimeout(resolve, 50));
      }
      const { view, model } = globalThis.covis;
      const buffers = view.gpuBytes + model.landmarks.bytes + model.keyframes.bytes;
      return { heap: performance.memory.usedJSHeapSize, buffers, three: view.renderer.info.memory.geometries };
    });
  await until(page, () => globalThis.covis?.model.revision === 1);
  const begin = Date.now();
  go();
  await until(page, (revision) => globalThis.covis.model.revision === revision, DELTAS / 2 + 1);
  held.push(await measure());
  half.reached();
  await until(page, (revision) => globalThis.covis.model.revision === revision, DELTAS + 1);
  const seconds = (Date.now() - begin) / 1000;
  held.push(await measure());
  const [middle, end] = held;
  t.diagnostic(`${DELTAS} deltas in ${seconds.toFixed(1)} s; heap ${middle.heap >> 10} KiB, then ${end.heap >> 10} KiB`);
  assert.deepEqual([end.buffers, end.three], [middle.buffers, middle.three]);
  assert.ok(end.heap < middle.heap * 1.1 + (1 << 20), `the heap grew from ${middle.heap} to ${end.heap}`);
  assert.deepEqual(errors, []);
  await close();
  leave();
  server.close();
});
