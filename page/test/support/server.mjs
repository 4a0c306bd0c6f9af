// A real server for a test, on ports that are free.

import { spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { fileURLToPath } from "node:url";

const built = fileURLToPath(new URL("../../../target/debug/covis", import.meta.url));
export const binary = [process.env.COVIS_BIN, built].find((path) => path && existsSync(path));

/** Starts `covis serve` with more arguments; answers its addresses and a way to end it. */
export async function serve({ http = "127.0.0.1:0" }, ...more) {
  const ports = ["--listen", "127.0.0.1:0", "--http", http];
  const args = ["serve", "--in-memory", ...ports, "--log", "warn", ...more];
  const child = spawn(binary, args, { stdio: ["ignore", "pipe", "inherit"] });
  const ended = new Promise((resolve) => child.once("exit", resolve));
  const lines = await new Promise((resolve, reject) => {
    let text = "";
    child.stdout.on("data", (chunk) => {
      text += chunk;
      if (text.includes("the page is at")) resolve(text);
    });
    ended.then((code) => reject(new Error(`covis serve ended with ${code}`)));
  });
  const grpc = /listening on (\S+)/.exec(lines)[1];
  const page = /the page is at (\S+)/.exec(lines)[1];
  const stop = async () => {
    child.kill("SIGTERM");
    await ended;
  };
  return { grpc, page, stop };
}
