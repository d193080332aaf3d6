import * as THREE from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "meshoptimizer";
import { kept, lit, serve } from "./measure.js";

const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(256, 256, false);
const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);

function draw(root) {
  const scene = new THREE.Scene();
  scene.add(root, new THREE.AmbientLight(0xffffff, 3));
  const box = new THREE.Box3().setFromObject(root);
  const centre = box.getCenter(new THREE.Vector3());
  const r = box.getSize(new THREE.Vector3()).length() / 2;
  const camera = new THREE.OrthographicCamera(-r, r, r, -r, 0, 4 * r);
  camera.position.copy(centre).add(new THREE.Vector3(0, 0, 2 * r));
  renderer.render(scene, camera);
  return lit(renderer.getContext()).length;
}

serve(`r${THREE.REVISION}`, async (url, sum, tile) => {
  const { scene } = await loader.loadAsync(url);
  scene.updateMatrixWorld(true);
  scene.traverse((node) => {
    if (!node.isMesh) return;
    const { position, normal } = node.geometry.attributes;
    const turn = new THREE.Matrix3().getNormalMatrix(node.matrixWorld);
    const v = new THREE.Vector3();
    const [points, normals] = [[], []];
    for (let i = 0; i < position.count; i++) {
      points.push(...v.fromBufferAttribute(position, i).applyMatrix4(node.matrixWorld).toArray());
      normals.push(...v.fromBufferAttribute(normal, i).applyMatrix3(turn).toArray());
    }
    // the loader makes lists of strips
    sum.add(points, node.geometry.index.array, normals, false);
    sum.names.push(node.name);
    if ("cell" in node.userData) sum.extras[`${tile} ${node.name}`] = kept(node.userData);
  });
  sum.pixels = Math.max(sum.pixels, draw(scene));
});
