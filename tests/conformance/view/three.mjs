// A page of three.js that loads the same tiles, to see how `alvis view` stands beside it.
import path from "node:path";
import { createRequire } from "node:module";
import { inside } from "../clients/chromium.mjs";
import { manifestOf, tilesOf } from "./set.mjs";

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
      const { grid, spacing } = manifestOf(set);
      const tiles = tilesOf(set).map((t) => t.path);
      return ["application/json", JSON.stringify({ tiles, box: grid.dims.map((n, k) => n * spacing[k] * 1e-3) })];
    }
    return ["model/gltf-binary", inside(set, url.slice(1))];
  };
}

const PAIRS = 5;

// Reads a pixel of the page, which waits until all is drawn, when the first picture stands and when all of it does.
const WATCH = `{
  const later = window.requestAnimationFrame.bind(window);
  let first = 0;
  window.requestAnimationFrame = (run) => later((time) => {
    run(time);
    const { alvis } = window;
    if (window.result || !(alvis?.draws > 0)) return;
    const complete = alvis.phase === "complete" && document.getElementById("cover").hidden;
    if (first && !complete) return;
    alvis.pick(1, 1);
    first ||= performance.now();
    if (complete) window.result = { first, complete: performance.now(), bytes: alvis.onCard, calls: alvis.draws };
  });
}`;

async function result(context, address, watch) {
  const tab = await context.newPage();
  if (watch) await tab.addInitScript(watch);
  await tab.goto(address);
  // evaluated again and again: the policy of one of the pages forbids what waits inside of it
  for (let i = 0; i < 1200; i++) {
    const found = await tab.evaluate(() => window.result);
    if (found) {
      await tab.close();
      return found;
    }
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  throw new Error(`${address} is never complete`);
}

function median(numbers) {
  return numbers.toSorted((a, b) => a - b)[numbers.length >> 1];
}

/** Prints times of both in turn. What does not depend on the machine is asked for: both draw, and bytes on the card. */
export async function compare(context, site, address) {
  const pairs = [];
  for (let i = 0; i < PAIRS; i++) {
    const [three, own] = [await result(context, `${site}/`), await result(context, address, WATCH)];
    if (!(three.calls > 0 && own.calls > 0)) throw new Error("one of the two drew nothing");
    pairs.push({ three, own });
  }
  const of = (who, what) => median(pairs.map((p) => p[who][what]));
  const ratio = (what) => median(pairs.map((p) => p.own[what] / p.three[what]));
  for (const what of ["first", "complete"]) {
    console.log(`   ${what} picture after ${of("own", what).toFixed(0)} ms, ${of("three", what).toFixed(0)} ms of three.js: ratio ${ratio(what).toFixed(2)}`);
  }
  console.log(`   draws ${of("own", "calls")}, ${of("three", "calls")} of three.js; bytes on the card ${ratio("bytes").toFixed(2)} of its`);
  if (ratio("bytes") > 0.5) throw new Error(`${ratio("bytes")} of the bytes of three.js are on the card`);
}
