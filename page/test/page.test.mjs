// The page in a real browser, with a real server. Where there is no browser the tests are skipped, with
// a line that says so.
//
// COVIS_TEST_PICTURES names a folder for pictures of every screen.

import assert from "node:assert/strict";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { createHash } from "node:crypto";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";

import { executable, launch, open, orbit, until } from "./support/browser.mjs";
import { Grpc } from "./support/grpc.mjs";
import { Robot, bare, camera, relative } from "./support/robot.mjs";
import { binary, serve } from "./support/server.mjs";

const pictures = process.env.COVIS_TEST_PICTURES;
const skip = !executable
  ? "skipped: no chromium"
  : !binary && "skipped: no covis, which COVIS_BIN or a debug build would be";

let browser;
before(async () => {
  if (!skip) browser = await launch();
});
after(() => browser?.close());

const shoot = async (page, name) => {
  if (pictures) await page.screenshot({ path: join(pictures, `${name}.png`) });
};

/** Runs `body` with a server, and ends it whatever comes. */
async function withServer(body, ...args) {
  const server = await serve({}, ...args);
  try {
    await body(server);
  } finally {
    await server.stop();
  }
}

const ODOMETRY = 1;
const LOOP_CLOSURE = 2;

test("a live map grows, is turned, and a keyframe is looked at", { skip }, async (t) => {
  await withServer(async (server) => {
    const grpc = new Grpc(server.grpc);
    await grpc.call("MapService", "CreateMap", { mapId: "hall", displayName: "The hall" });
    const robot = new Robot(400, 4000);
    const stream = await grpc.ingest("hall", "robot-1");
    await stream.item("camera", camera);
    for (let k = 0; k < 12; k++) {
      await stream.optimized(await stream.item("keyframe", robot.keyframe(k)));
    }

    const { page, errors, close } = await open(browser, server.page);
    await until(page, () => globalThis.covis?.model.keyframes.size === 12);
    await page.getByText("12 keyframes").first().waitFor();
    await page.locator("#connection", { hasText: "Live" }).waitFor();
    await shoot(page, "map-dark");

    // From the moment a keyframe is sent until the page has drawn it, on one clock.
    await page.evaluate(() => {
      globalThis.seenAt = new Map();
      const told = globalThis.covis.view.onFrame;
      globalThis.covis.view.onFrame = () => {
        told();
        const { size } = globalThis.covis.model.keyframes;
        if (!globalThis.seenAt.has(size)) globalThis.seenAt.set(size, Date.now());
      };
    });
    const took = [];
    for (let k = 12; k < 40; k++) {
      const sentAt = Date.now();
      await stream.item("keyframe", robot.keyframe(k));
      await until(page, (size) => globalThis.seenAt.has(size), k + 1);
      took.push((await page.evaluate((size) => globalThis.seenAt.get(size), k + 1)) - sentAt);
    }
    took.sort((a, b) => a - b);
    const latency = `median ${took[took.length >> 1]} ms, largest ${took.at(-1)} ms`;
    t.diagnostic(`keyframe sent until seen: ${latency}`);
    await until(page, () => document.querySelector("#counts").textContent.startsWith("40 keyframes"));

    const before = await page.evaluate(() => globalThis.covis.view.camera.position.toArray());
    const rate = await orbit(page, 1000);
    t.diagnostic(`${rate.toFixed(0)} frames a second while it turns`);
    const behind = await page.evaluate(() => globalThis.covis.view.camera.position.toArray());
    assert.notDeepEqual(behind, before, "the mouse turns the view");
    await page.locator("#view").press("ArrowLeft");
    const turned = await page.evaluate(() => globalThis.covis.view.camera.position.toArray());
    assert.notDeepEqual(turned, behind, "an arrow key turns it too");
    await page.locator("#view").press("Home");

    // The pixel of one observation is 5 px off to the right.
    const wrong = robot.keyframe(40, 200, (n) => (n === 3 ? [5, 0] : [0, 0]));
    await stream.optimized(await stream.item("keyframe", wrong));
    await until(page, () => globalThis.covis.model.keyframes.size === 41);
    const slot = await page.evaluate(() => globalThis.covis.model.keyframes.get("robot-1", 40));
    const [x, y] = await page.evaluate((s) => globalThis.covis.view.screenPosition(s), slot);
    await page.locator("#view").click({ position: { x, y } });
    await page.getByText("Largest residuals").waitFor();
    const picked = await page.evaluate(() => globalThis.covis.panels.keyframe.chosen);
    assert.equal(picked.client, "robot-1");
    await page.getByLabel("Keyframe, as client/id").fill("robot-1/40");
    await page.getByRole("button", { name: "Go" }).click();
    await page.getByRole("heading", { name: "robot-1/40" }).waitFor();
    await page.getByText("Largest residuals").waitFor();
    const row = await page.locator("#panel-keyframe tbody tr").first().innerText();
    const [name, , , length] = row.split("\t");
    const { landmark } = wrong.observations[3];
    assert.equal(name, `robot-1/${landmark.id}`, row);
    assert.ok(Math.abs(Number(length) - 5) < 1, `the residual that was made: ${row}`);
    await shoot(page, "keyframe-dark");

    await page.getByRole("tab", { name: "Map" }).click();
    await page.getByLabel("Covisibility").check();
    await page.getByLabel("Trajectory, odometry alone").check();
    await page.getByLabel("Landmarks by").selectOption("error");
    await until(page, () => globalThis.covis.view.edges.length > 0 && globalThis.covis.view.errors);
    const [edges, worst, largest] = await page.evaluate(() => {
      const { view, model } = globalThis.covis;
      const at = view.errors.indexOf(Math.max(...view.errors));
      return [view.edges.length, String(model.landmarks.owner(at).id), view.errors[at]];
    });
    assert.ok(edges >= 40, `${edges} edges of covisibility`);
    assert.equal(worst, String(landmark.id), `its error is ${largest} px`);
    await shoot(page, "layers-dark");
    await page.getByRole("button", { name: "Light" }).click();
    await page.waitForTimeout(300);
    await shoot(page, "layers-light");

    await page.getByRole("tab", { name: "Metrics" }).click();
    await page.locator("#panel-metrics canvas").first().waitFor();
    await until(page, () => globalThis.covis.panels.metrics.times.length > 2);
    await shoot(page, "metrics-light");
    await page.getByRole("tab", { name: "Jobs" }).click();
    await page.locator("#panel-jobs").getByText(/jobs/i).first().waitFor();
    await shoot(page, "jobs-light");

    // A keyframe that goes leaves the view.
    await stream.item("removeKeyframe", { keyframe: { id: 40n } });
    await until(page, () => globalThis.covis.model.keyframes.size === 40);
    assert.deepEqual(errors, []);
    await close();
    grpc.close();
  });
});

test("a closure is doubted, and counts once another one agrees", { skip }, async () => {
  await withServer(async (server) => {
    const grpc = new Grpc(server.grpc);
    await grpc.call("MapService", "CreateMap", { mapId: "loop" });
    const stream = await grpc.ingest("loop", "robot-1");
    // Around a square whose odometry drifts by more than it says: it ends 2 m off its begin.
    const side = 8;
    const corners = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]];
    const truth = [];
    for (let k = 0; k <= 4 * side; k++) {
      const corner = Math.min(Math.floor(k / side), 3);
      const [from, to] = [corners[corner], corners[corner + 1]];
      const share = k / side - corner;
      truth.push([0, 1].map((i) => side * (from[i] + (to[i] - from[i]) * share)));
    }
    const drifted = truth.map(([x, y], k) => [x + (2 * k) / (4 * side), y]);
    let id = 0;
    for (let k = 0; k < drifted.length; k++) {
      await stream.item("keyframe", bare(k, ...drifted[k]));
      if (k === 0) continue;
      const step = [0, 1].map((i) => drifted[k][i] - drifted[k - 1][i]);
      await stream.item("relativePose", relative(id++, ODOMETRY, k - 1, k, step, 0.01, 0.002));
    }
    const { page, errors, close } = await open(browser, server.page);
    await until(page, (size) => globalThis.covis?.model.keyframes.size === size, drifted.length);
    await page.getByRole("tab", { name: "Closures" }).click();
    await page.getByText("This map has no loop closures.").waitFor();

    const closure = (i, j) => {
      const between = [0, 1].map((k) => truth[j][k] - truth[i][k]);
      return relative(id++, LOOP_CLOSURE, i, j, between, 0.02, 0.002);
    };
    const last = drifted.length - 1;
    await stream.optimized(await stream.item("relativePose", closure(0, last)));
    await page.locator("#panel-closures td .provisional").waitFor();
    await page.getByText("no other closure joins its places").waitFor();
    await shoot(page, "closure-provisional-dark");
    await stream.optimized(await stream.item("relativePose", closure(1, last - 1)));
    await page.locator("#panel-closures td .accepted").nth(1).waitFor();
    assert.equal(await page.locator("#panel-closures td .provisional").count(), 0);
    await shoot(page, "closure-accepted-dark");
    assert.deepEqual(errors, []);
    await close();
    grpc.close();
  });
});

test("a job is followed, and canceled by its button", { skip }, async () => {
  await withServer(async (server) => {
    const grpc = new Grpc(server.grpc);
    const { page, errors, close } = await open(browser, server.page);
    await page.getByRole("tab", { name: "Jobs" }).click();
    const answer = await grpc.call("JobService", "ListJobs").catch((error) => error);
    if (answer instanceof Error) {
      assert.match(answer.message, /code 12/);
      await page.getByText("This server has no jobs.").waitFor();
    } else {
      await page.getByText("covis job submit makes one").waitFor();
      // A map that takes some hundred iterations of a tenth of a second, which the test does not wait for.
      await grpc.call("MapService", "CreateMap", { mapId: "hall", policy: { localBundleAdjustment: false } });
      const robot = new Robot(400, 20_000);
      const stream = await grpc.ingest("hall", "robot-1");
      const off = (n) => [n % 3, n % 2];
      const sent = [stream.item("camera", camera)];
      for (let k = 0; k < 400; k++) sent.push(stream.item("keyframe", robot.keyframe(k, 700, off)));
      await Promise.all(sent);
      const options = { maxIterationCount: 10_000, functionTolerance: 0, gradientTolerance: 0, parameterTolerance: 0 };
      const spec = { case: "optimizeMap", value: { mapId: "hall", options } };
      await grpc.call("JobService", "CreateJob", { jobId: "adjust", spec: { spec } });
      // The iteration that the page shows comes to be larger than the first one that it showed.
      await until(page, () => {
        const shown = /iteration ([\d,]+)/.exec(document.querySelector("#panel-jobs").textContent);
        if (!shown) return false;
        const iteration = Number(shown[1].replace(",", ""));
        globalThis.firstIteration ??= iteration;
        return iteration > globalThis.firstIteration;
      });
      await shoot(page, "jobs-dark");
      await page.getByRole("button", { name: "Cancel adjust" }).click();
      await page.locator("#panel-jobs").getByText("cancelled").waitFor();
    }
    assert.deepEqual(errors, []);
    await close();
    grpc.close();
  });
});

test("a wrong token is refused, the right one is not, and none is in a URL", { skip }, async () => {
  const folder = mkdtempSync(join(tmpdir(), "covis-page-"));
  const hash = (secret) => createHash("sha256").update(secret).digest("hex");
  const tokens = ["reader", "chief"].map((name) =>
    `[[token]]\nname = "${name}"\nsha256 = "${hash(`secret of ${name}`)}"\nrole = "${name === "chief" ? "admin" : "read"}"\n`);
  writeFileSync(join(folder, "tokens.toml"), tokens.join("\n"));
  try {
    await withServer(async (server) => {
      const grpc = new Grpc(server.grpc, "secret of chief");
      await grpc.call("MapService", "CreateMap", { mapId: "hall" });
      const { page, errors, close } = await open(browser, server.page);
      const urls = [];
      page.on("request", (request) => urls.push(request.url()));
      await page.getByRole("dialog").waitFor();
      await page.getByRole("textbox", { name: "Token" }).fill("secret of nobody");
      await page.getByRole("button", { name: "Use" }).click();
      await page.getByRole("alert").getByText("the token is not known").waitFor();
      await shoot(page, "token-dark");
      assert.equal(await page.locator("#maps li").count(), 0);
      await page.getByRole("textbox", { name: "Token" }).fill("secret of reader");
      await page.keyboard.press("Enter");
      await page.locator("#maps li", { hasText: "hall" }).waitFor();
      await page.getByRole("dialog").waitFor({ state: "hidden" });
      await page.getByText("This map is empty.").waitFor();
      await page.getByRole("tab", { name: "Metrics" }).click();
      await page.getByText("they need a token of an administrator").waitFor();
      await shoot(page, "metrics-refused-dark");
      const kept = await page.evaluate(() => [localStorage.length, document.cookie, location.href]);
      assert.deepEqual(kept, [0, "", server.page]);
      assert.ok(urls.every((url) => !url.includes("secret")), "no token in a URL");
      // The tab keeps it when it is loaded again, another tab does not have it.
      await page.reload();
      await page.locator("#maps li", { hasText: "hall" }).waitFor();
      assert.equal(await page.locator("#token-dialog[open]").count(), 0);
      // The browser itself writes a line for each answer 403: the metrics, once for each time it was loaded.
      const refused = "error: Failed to load resource: the server responded with a status of 403 (Forbidden)";
      assert.deepEqual(errors, [refused, refused]);
      await close();
      grpc.close();
    }, "--tokens", join(folder, "tokens.toml"));
  } finally {
    rmSync(folder, { recursive: true });
  }
});

test("the page goes on when its server comes back", { skip }, async () => {
  const first = await serve({});
  const address = new URL(first.page).host;
  const { page, close } = await open(browser, first.page);
  await page.getByText("This server has no maps yet.").waitFor();
  await first.stop();
  await page.locator('#connection[data-state="failed"]').waitFor();
  const second = await serve({ http: address });
  try {
    const grpc = new Grpc(second.grpc);
    await grpc.call("MapService", "CreateMap", { mapId: "hall" });
    await page.locator("#maps li", { hasText: "hall" }).waitFor();
    await page.locator('#connection[data-state="live"]').waitFor();
    // A map that is deleted while it is shown.
    await grpc.call("MapService", "DeleteMap", { mapId: "hall" });
    await page.getByText("Map hall is gone").waitFor();
    grpc.close();
  } finally {
    await second.stop();
    await close();
  }
});
