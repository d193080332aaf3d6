// Headless Chromium, and a small server on this machine for the pages that it opens.
import fs from "node:fs";
import http from "node:http";
import os from "node:os";
import path from "node:path";
import { createRequire } from "node:module";

// The file of a name inside of a directory.
export function inside(base, name) {
  const file = path.resolve(path.join(base, name));
  if (!file.startsWith(path.resolve(base) + path.sep)) throw new Error(`${name} is outside`);
  return fs.readFileSync(file);
}

// Starts both; ANSWER gives the type and the bytes for the path of a URL, or throws. NPM is where package.json is
// installed. Returns the browser's context, where the server is, and what ends both.
export async function start(npm, viewport, answer) {
  const { chromium } = createRequire(path.join(path.resolve(npm), "x.js"))("playwright-core");
  const server = http.createServer((request, response) => {
    try {
      const [type, body] = answer(decodeURIComponent(request.url.split("?")[0]));
      response.setHeader("content-type", type);
      response.end(body);
    } catch {
      response.statusCode = 404;
      response.end();
    }
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  const profile = fs.mkdtempSync(path.join(os.tmpdir(), "alvis-chromium-"));
  const context = await chromium.launchPersistentContext(profile, {
    executablePath: "/usr/bin/chromium",
    headless: true,
    viewport,
    args: ["--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader",
      "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run", "--disable-background-networking"],
  });
  const end = async () => {
    await context.close();
    server.close();
    fs.rmSync(profile, { recursive: true, force: true });
  };
  return { context, site: `http://127.0.0.1:${server.address().port}`, end };
}
