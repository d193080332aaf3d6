// A page of three.js that loads the same tiles, to see how `alvis view` stands beside it.
import fs from "node:fs";
import path from "node:path";
import { createRequire } from "node:module";
import { inside } from "../clients/chromium.mjs";

const PAGE = `<!doctype html><meta charset="utf-8"><body style="margin:0"><script type="module" src="/page.js"></script>`;

const SCRIPT = `
import * as THREE from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
const renderer = new THREE.WebGLRenderer({ antialias: false });
renderer.setSize(innerWidth, innerHeight);
document.body.append(renderer.domElement);
const scene = new THREE.Scene();
scene.add(new THREE.HemisphereLight(0xffffff, 0x444444, 3));
const camera = new THREE.PerspectiveCamera(35, innerWidth / innerHeight, 1e-5, 1);
const { tiles, box } = await (await fetch("/tiles.json")).json();
const size = Math.hypot(...box);
camera.position.set(size, size * 0.7, size);
camera.lookAt(box[0] / 2, box[2] / 2, -box[1] / 2);
let bytes = 0;
let first = 0;
const gl = renderer.getContext();
// reading a pixel waits until all is drawn, which finish() does not
const draw = () => {
  renderer.render(scene, camera);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
};
const queue = [...tiles];
const loader = new GLTFLoader();
const work = async () => {
  while (queue.length > 0) {
    const { scene: part } = await loader.loadAsync("/" + queue.shift());
    part.traverse((n) => {
      if (!n.isMesh) return;
      for (const a of [...Object.values(n.geometry.attributes), n.geometry.index]) bytes += a.array.byteLength;
    });
    scene.add(part);
    if (!first) { draw(); first = performance.now(); }
  }
};
await Promise.all(Array.from({ length: 6 }, work));
draw();
window.result = { first, complete: performance.now(), bytes, calls: renderer.info.render.calls };
`;

/** Answers for a server: the page, and the tiles of a set. */
export function answerThree(npm, set) {
  let bundle = null;
  return (url) => {
    if (url === "/") return ["text/html", PAGE];
    if (url === "/page.js") {
      const esbuild = createRequire(path.join(path.resolve(npm), "x.js"))("esbuild");
      bundle ??= esbuild.buildSync({
        stdin: { contents: SCRIPT, resolveDir: path.resolve(npm) },
        bundle: true, format: "esm", write: false, logLevel: "error",
      }).outputFiles[0].contents;
      return ["text/javascript", Buffer.from(bundle)];
    }
    if (url === "/tiles.json") {
      const { layers, grid, spacing } = JSON.parse(fs.readFileSync(path.join(set, "index.json"), "utf8"));
      const tiles = layers.flatMap((l) => JSON.parse(fs.readFileSync(path.join(set, l.path), "utf8")).tiles.map((t) => t.path));
      return ["application/json", JSON.stringify({ tiles, box: grid.dims.map((n, k) => n * spacing[k] * 1e-3) })];
    }
    return ["model/gltf-binary", inside(set, url.slice(1))];
  };
}

/** Prints times and bytes of both as ratios. Only that both drew is asked for. */
export async function compare(context, site, open) {
  const tab = await context.newPage();
  await tab.goto(`${site}/`);
  await tab.waitForFunction("window.result", null, { timeout: 120000 });
  const three = await tab.evaluate("window.result");
  await tab.close();
  const session = await open("blender", { settle: false });
  let first = 0;
  const own = await session.until(() => {
    const { alvis } = window;
    if (!alvis || alvis.phase === "waiting") return null;
    const drawn = () => {
      alvis.pick(1, 1);
      return performance.now();
    };
    window.firstDraw ??= alvis.draws > 0 ? drawn() : undefined;
    return alvis.phase === "complete" ? { first: window.firstDraw, complete: drawn(), bytes: alvis.onCard, draws: alvis.draws } : null;
  });
  first = own.first;
  const ratio = (a, b) => (a / b).toFixed(2);
  const seconds = (ms) => (ms / 1000).toFixed(1);
  console.log(`   first picture ${seconds(first)} s to ${seconds(three.first)} s, complete ${seconds(own.complete)} s to ${seconds(three.complete)} s of three.js`);
  console.log(`   ratios: first picture ${ratio(first, three.first)}, complete ${ratio(own.complete, three.complete)}, bytes on the card ${ratio(own.bytes, three.bytes)}, draws ${own.draws} to ${three.calls} of three.js`);
  if (!(three.calls > 0 && own.draws > 0)) throw new Error("one of the two drew nothing");
  await session.close();
}
