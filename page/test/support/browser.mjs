// A real browser without a window, whose console and network a test looks at.

import { existsSync } from "node:fs";
import { chromium } from "playwright-core";

const CANDIDATES = [process.env.COVIS_TEST_CHROMIUM, "/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
export const executable = CANDIDATES.find((path) => path && existsSync(path));

const ARGS = [
  "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
  "--disable-background-networking", "--disable-component-update", "--disable-sync",
  // WebGL by software.
  "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
  // The heap is measured.
  "--enable-precise-memory-info", "--js-flags=--expose-gc",
];

export const launch = () => chromium.launch({ executablePath: executable, args: ARGS });

/** A page of 1280 x 720 at `url`; `errors` gets what the console and the network report. */
export async function open(browser, url, { theme = "dark" } = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 720 }, colorScheme: theme });
  const page = await context.newPage();
  const errors = [];
  page.on("console", (line) => {
    // A browser that draws by software says so.
    if (line.text().includes("GL Driver Message")) return;
    if (["error", "warning"].includes(line.type())) errors.push(`${line.type()}: ${line.text()}`);
  });
  page.on("pageerror", (error) => errors.push(`uncaught: ${error.stack}`));
  page.on("request", (request) => {
    if (!request.url().startsWith(url)) errors.push(`a request to ${request.url()}`);
  });
  await page.goto(url);
  return { page, errors, close: () => context.close() };
}

/** Waits until `what()` of the app holds in the page. */
export const until = (page, what, argument) =>
  page.waitForFunction(what, argument, { timeout: 30_000, polling: 50 });

/** Turns the view a little in each frame for a while; answers frames per second. */
export const spin = (page, milliseconds) =>
  page.evaluate((milliseconds) => new Promise((resolve) => {
    const { view } = globalThis.covis;
    const [first, begin] = [view.stats.frames, performance.now()];
    const step = (now) => {
      if (now - begin >= milliseconds) return resolve(((view.stats.frames - first) * 1000) / (now - begin));
      view.turn(0.02, 0);
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }), milliseconds);

/** How often a mouse tells that it moved, ms. */
const MOUSE_MS = 8;

/**
 * Turns the view with the mouse for a while; answers frames per second. The mouse does not wait for the
 * page, as no mouse does.
 */
export async function orbit(page, milliseconds) {
  const box = await page.locator("#view").boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  const frames = () => page.evaluate(() => [globalThis.covis.view.stats.frames, performance.now()]);
  const [first, begin] = await frames();
  const moves = [];
  for (let at = 0; at < milliseconds; at += MOUSE_MS) {
    moves.push(page.mouse.move(x + 200 * Math.sin(at / 320), y + 40 * Math.sin(at / 530)));
    await new Promise((resolve) => setTimeout(resolve, MOUSE_MS));
  }
  const [last, now] = await frames();
  await Promise.all(moves);
  await page.mouse.up();
  return ((last - first) * 1000) / (now - begin);
}
