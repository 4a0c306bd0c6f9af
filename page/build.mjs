// Builds the page into `dist/`, which the Rust build embeds. With `--check` it only compares.
//
// `dist/sources.sha256` names the sources that the bundle was made from: a Rust test compares it with
// the sources, so that a stale bundle is found where there is no Node.

import { createHash } from "node:crypto";
import { mkdirSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { dirname, join, relative } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const root = dirname(fileURLToPath(import.meta.url));
const dist = join(root, "dist");

/** Every file that the bundle depends on, by path. */
function sources() {
  const files = ["build.mjs", "package.json", "package-lock.json"];
  const walk = (folder) => {
    for (const entry of readdirSync(join(root, folder), { withFileTypes: true })) {
      const path = `${folder}/${entry.name}`;
      if (entry.isDirectory()) walk(path);
      else files.push(path);
    }
  };
  walk("src");
  return files.sort();
}

/** The digest of the sources: of each its path, its size and its bytes. */
function digest() {
  const hash = createHash("sha256");
  for (const path of sources()) {
    const bytes = readFileSync(join(root, path));
    hash.update(`${path}\0${bytes.length}\0`);
    hash.update(bytes);
  }
  return `${hash.digest("hex")}\n`;
}

const result = await build({
  absWorkingDir: root,
  entryPoints: { page: "src/main.js" },
  outdir: dist,
  bundle: true,
  minify: true,
  write: false,
  format: "esm",
  target: ["chrome110", "firefox115", "safari16.4"],
  legalComments: "inline",
  logLevel: "warning",
});
const made = new Map(result.outputFiles.map((file) => [relative(dist, file.path), file.contents]));
for (const name of ["index.html", "icon.svg"]) {
  made.set(name, readFileSync(join(root, "src", name)));
}
made.set("sources.sha256", Buffer.from(digest()));

if (process.argv.includes("--check")) {
  const isStale = ([name, bytes]) => !readFileSync(join(dist, name)).equals(Buffer.from(bytes));
  const stale = [...made].filter(isStale).map(([name]) => name);
  if (stale.length > 0) {
    console.error(`page/dist is stale: ${stale.join(", ")}; run: npm --prefix page run build`);
    process.exit(1);
  }
} else {
  mkdirSync(dist, { recursive: true });
  for (const [name, bytes] of made) writeFileSync(join(dist, name), bytes);
  for (const [name, bytes] of made) console.log(`${name} ${bytes.length} bytes`);
}
