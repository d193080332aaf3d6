import { LoadAssetContainerAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { MeshoptCompression } from "@babylonjs/core/Meshes/Compression/meshoptCompression.js";
import { NullEngine } from "@babylonjs/core/Engines/nullEngine.js";
import { Scene } from "@babylonjs/core/scene.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import "@babylonjs/loaders/glTF/2.0/index.js";
import { kept, serve } from "./measure.js";

MeshoptCompression.Configuration = { decoder: { url: "/meshopt_decoder.js" } };
const TRIANGLE_STRIP = 7;
const engine = new NullEngine();

serve(NullEngine.Version, async (url, sum, tile) => {
  const scene = new Scene(engine);
  scene.useRightHandedSystem = true;
  const { meshes } = await LoadAssetContainerAsync(url, scene);
  for (const mesh of meshes.filter((m) => m.getTotalVertices() > 0)) {
    const world = mesh.computeWorldMatrix(true);
    const turn = world.clone().invert().transpose();
    const [positions, normals] = ["position", "normal"].map((kind) => mesh.getVerticesData(kind));
    const points = [];
    const turned = [];
    for (let i = 0; i < positions.length; i += 3) {
      const v = Vector3.TransformCoordinates(Vector3.FromArray(positions, i), world);
      const n = Vector3.TransformNormal(Vector3.FromArray(normals, i), turn);
      points.push(v.x, v.y, v.z);
      turned.push(n.x, n.y, n.z);
    }
    sum.add(points, mesh.getIndices(), turned, mesh.material.fillMode === TRIANGLE_STRIP);
    sum.names.push(mesh.name);
    const extras = mesh.metadata?.gltf?.extras;
    if (extras) sum.extras[`${tile} ${mesh.name}`] = kept(extras);
  }
  scene.dispose();
});
