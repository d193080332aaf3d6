// Shows a tileset in three.js with 3d-tiles-renderer from a given place, and says what was drawn, picked and coloured.
import * as THREE from "three";
import { MeshoptDecoder } from "meshoptimizer";
import { TilesRenderer } from "3d-tiles-renderer";
import { GLTFExtensionsPlugin } from "3d-tiles-renderer/plugins";

const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(256, 256);
document.getElementById("view").append(renderer.domElement);
const wait = () => new Promise((resolve) => setTimeout(resolve, 10));

function camera(view) {
  const made = new THREE.PerspectiveCamera((view.angle * 180) / Math.PI, 1, view.near, view.far);
  made.position.set(...view.eye);
  made.up.set(...view.up);
  made.lookAt(made.position.clone().add(new THREE.Vector3(...view.direction)));
  made.updateMatrixWorld();
  return made;
}

// The cell of a row of the property table.
function cellOf(mesh, row) {
  const data = mesh.userData.structuralMetadata.getPropertyTableData([0], [row])[0];
  return Number(data.cell);
}

function pick(group, seen, [x, y]) {
  const ray = new THREE.Raycaster();
  ray.setFromCamera(new THREE.Vector2((x + 0.5) / 128 - 1, 1 - (y + 0.5) / 128), seen);
  const hit = ray.intersectObject(group, true)[0];
  if (!hit) return null;
  const ids = hit.object.geometry.attributes._feature_id_0;
  return cellOf(hit.object, ids.getX(hit.face.a));
}

// The triangles of a strip that have three corners, or of a list.
function drawn(mesh) {
  const { index } = mesh.geometry;
  if (mesh.drawMode !== THREE.TriangleStripDrawMode && !mesh.isStrip) {
    let count = 0;
    for (let i = 0; i < index.count; i += 3) {
      const [a, b, c] = [index.getX(i), index.getX(i + 1), index.getX(i + 2)];
      if (a !== b && b !== c && a !== c) count++;
    }
    return count;
  }
  throw new Error("a strip was left as it is");
}

// Paints the vertices of a cell red, all others white.
function paint(mesh, cell) {
  const ids = mesh.geometry.attributes._feature_id_0;
  const known = new Map();
  const colours = new Float32Array(3 * ids.count);
  for (let i = 0; i < ids.count; i++) {
    const row = ids.getX(i);
    if (!known.has(row)) known.set(row, cellOf(mesh, row));
    colours.set(known.get(row) === cell ? [1, 0, 0] : [1, 1, 1], 3 * i);
  }
  mesh.geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  mesh.material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });
}

function reddish() {
  const gl = renderer.getContext();
  const pixels = new Uint8Array(256 * 256 * 4);
  gl.readPixels(0, 0, 256, 256, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let [lit, red] = [0, 0];
  for (let i = 0; i < pixels.length; i += 4) {
    if (pixels[i] + pixels[i + 1] + pixels[i + 2] > 60) lit++;
    if (pixels[i] > 60 && pixels[i + 1] < pixels[i] / 3) red++;
  }
  return { lit, red };
}

window.run = async ({ url, target, view, points, cell }) => {
  const set = new TilesRenderer(url);
  set.registerPlugin(new GLTFExtensionsPlugin({ metadata: true, meshoptDecoder: MeshoptDecoder }));
  const seen = camera(view);
  set.setCamera(seen);
  set.setResolution(seen, 256, 256);
  set.errorTarget = target;
  let failed = null;
  set.addEventListener("load-error", (e) => (failed = `${e.url}: ${e.error?.message ?? e.error}`));
  const scene = new THREE.Scene();
  scene.add(set.group, new THREE.HemisphereLight(0xffffff, 0x888888, 3));
  for (let n = 0, quiet = 0; n < 2000 && quiet < 8 && !failed; n++) {
    set.update();
    renderer.render(scene, seen);
    await wait();
    const { downloading, parsing, queued = 0 } = set.stats;
    quiet = n > 5 && set.visibleTiles.size > 0 && downloading + parsing + queued === 0 ? quiet + 1 : 0;
  }
  renderer.render(scene, seen);
  let triangles = 0;
  set.group.traverse((node) => node.isMesh && (triangles += drawn(node)));
  const files = [...set.visibleTiles].map((tile) => tile.content.uri);
  const picks = points.map((point) => pick(set.group, seen, point));
  set.group.traverse((node) => node.isMesh && paint(node, cell));
  renderer.render(scene, seen);
  const coloured = reddish();
  scene.remove(set.group);
  set.dispose();
  return { failed, files, triangles, picks, ...coloured };
};
window.version = THREE.REVISION;
window.ready = true;
