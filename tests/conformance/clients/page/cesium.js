import * as Cesium from "cesium";
import { kept, lit, serve } from "./measure.js";

const widget = new Cesium.CesiumWidget(document.getElementById("view"), {
  baseLayer: false,
  globe: false,
  skyBox: false,
  skyAtmosphere: false,
  useDefaultRenderLoop: false,
  contextOptions: { webgl: { preserveDrawingBuffer: true } },
});
const { scene } = widget;
scene.backgroundColor = Cesium.Color.BLACK;
scene.light = new Cesium.DirectionalLight({ direction: new Cesium.Cartesian3(0.3, 0.3, -1), intensity: 5 });

function frames(count) {
  for (let i = 0; i < count; i++) {
    scene.initializeFrame();
    scene.render();
  }
}

function look({ center, radius }) {
  const destination = Cesium.Cartesian3.add(center, new Cesium.Cartesian3(0, 0, 2.5 * radius), new Cesium.Cartesian3());
  const [direction, up] = [new Cesium.Cartesian3(0, 0, -1), new Cesium.Cartesian3(0, 1, 0)];
  scene.camera.setView({ destination, orientation: { direction, up } });
  scene.camera.frustum.near = radius / 10;
  scene.camera.frustum.far = 10 * radius;
}

// The bytes of a buffer on the graphics card; many pieces share one, and fetching it is slow.
function content(buffer, known) {
  if (!known.has(buffer)) {
    const bytes = new Uint8Array(buffer.sizeInBytes);
    buffer.getBufferData(bytes);
    known.set(buffer, new DataView(bytes.buffer));
  }
  return known.get(buffer);
}

// `count` elements of `size` numbers.
function numbers(attribute, view, type, size) {
  const width = Cesium.ComponentDatatype.getSizeInBytes(type);
  const read = {
    [Cesium.ComponentDatatype.FLOAT]: (at) => view.getFloat32(at, true),
    [Cesium.ComponentDatatype.UNSIGNED_INT]: (at) => view.getUint32(at, true),
    [Cesium.ComponentDatatype.UNSIGNED_SHORT]: (at) => view.getUint16(at, true),
    [Cesium.ComponentDatatype.BYTE]: (at) => view.getInt8(at) / (attribute.normalized ? 127 : 1),
  }[type];
  const stride = attribute.byteStride ?? size * width;
  const out = [];
  for (let i = 0; i < attribute.count; i++) {
    for (let k = 0; k < size; k++) out.push(read((attribute.byteOffset ?? 0) + i * stride + k * width));
  }
  return out;
}

function measure(node, sum, known) {
  const world = node.computedTransform;
  const turn = Cesium.Matrix4.inverseTranspose(world, new Cesium.Matrix4());
  const names = [];
  for (const { primitive } of node.runtimePrimitives) {
    const [positions, normals] = ["POSITION", "NORMAL"].map((semantic) => {
      const attribute = primitive.attributes.find((a) => a.semantic === semantic);
      return numbers(attribute, content(attribute.buffer, known), attribute.componentDatatype, 3);
    });
    const { indices } = primitive;
    const list = numbers(indices, content(indices.buffer, known), indices.indexDatatype, 1);
    const points = [];
    const turned = [];
    for (let i = 0; i < positions.length; i += 3) {
      const v = Cesium.Cartesian3.unpack(positions, i);
      const n = Cesium.Cartesian3.unpack(normals, i);
      const p = Cesium.Matrix4.multiplyByPoint(world, v, new Cesium.Cartesian3());
      const d = Cesium.Matrix4.multiplyByPointAsVector(turn, n, new Cesium.Cartesian3());
      points.push(p.x, p.y, p.z);
      turned.push(d.x, d.y, d.z);
    }
    sum.add(points, list, turned, primitive.primitiveType === Cesium.PrimitiveType.TRIANGLE_STRIP);
    names.push(node.node.name);
  }
  sum.names.push(...names);
}

// The numbers of the cell under one of a few pixels: picking draws the scene, which is slow here.
function pick(pixels) {
  for (const part of [0.5, 0.35, 0.65]) {
    const [x, y] = pixels[Math.floor(part * pixels.length)];
    const found = scene.pick(new Cesium.Cartesian2(x, y));
    if (found?.getProperty?.("cell")) {
      return kept(Object.fromEntries(found.getPropertyIds().map((id) => [id, found.getProperty(id)])));
    }
  }
  return null;
}

serve(Cesium.VERSION, async (url, sum) => {
  // drawing without a graphics card is slow: one tile of a set is enough of a picture
  const show = sum.pixels === 0;
  const model = scene.primitives.add(await Cesium.Model.fromGltfAsync({ url, show }));
  await new Promise((resolve, reject) => {
    model.errorEvent.addEventListener(reject);
    const wait = () => (model.ready ? resolve() : (frames(1), setTimeout(wait, 5)));
    wait();
  });
  const known = new Map();
  for (const node of model.sceneGraph._runtimeNodes) {
    if (node?.runtimePrimitives.length > 0) measure(node, sum, known);
  }
  if (show) {
    look(model.boundingSphere);
    frames(2);
    const pixels = lit(scene.context._gl);
    sum.pixels = pixels.length;
    if (model.structuralMetadata && pixels.length > 0) sum.picked = pick(pixels);
  }
  scene.primitives.remove(model);
});
