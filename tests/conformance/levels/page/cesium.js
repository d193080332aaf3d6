// Shows a tileset in CesiumJS from a given place, and says what was drawn, picked and coloured.
import * as Cesium from "cesium";

const widget = new Cesium.CesiumWidget(document.getElementById("view"), {
  baseLayer: false,
  globe: false,
  skyBox: false,
  skyAtmosphere: false,
  useDefaultRenderLoop: false,
  useBrowserRecommendedResolution: false,
  contextOptions: { webgl: { preserveDrawingBuffer: true } },
});
const { scene } = widget;
scene.backgroundColor = Cesium.Color.BLACK;
scene.msaaSamples = 1;
scene.highDynamicRange = false;
widget.canvas.style.width = widget.canvas.style.height = "256px";
widget.resize();

const frame = () => {
  scene.initializeFrame();
  scene.render();
};
const wait = () => new Promise((resolve) => setTimeout(resolve, 10));
const vector = ([x, y, z]) => new Cesium.Cartesian3(x, y, z);

// Near the middle of the Earth headings and pitches have no meaning, so the camera is put down axis by axis.
function look(view) {
  const { camera } = scene;
  camera.position = vector(view.eye);
  camera.direction = vector(view.direction);
  camera.right = vector(view.right);
  camera.up = vector(view.up);
  Object.assign(camera.frustum, { fov: view.angle, near: view.near, far: view.far });
}

function reddish() {
  const gl = scene.context._gl;
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
  const set = scene.primitives.add(
    await Cesium.Cesium3DTileset.fromUrl(url, { maximumScreenSpaceError: target, skipLevelOfDetail: false }),
  );
  let failed = null;
  set.tileFailed.addEventListener((e) => (failed = `${e.url}: ${e.message}`));
  look(view);
  for (let n = 0, quiet = 0; n < 2000 && quiet < 5 && !failed; n++) {
    frame();
    await wait();
    quiet = n > 3 && set.tilesLoaded ? quiet + 1 : 0;
  }
  const files = [];
  let triangles = 0;
  for (const tile of set._selectedTiles) {
    files.push(tile.content.url);
    triangles += tile.content.trianglesLength;
  }
  const picks = points.map(([x, y]) => scene.pick(new Cesium.Cartesian2(x, y), 1, 1)?.getProperty?.("cell") ?? null);
  set.style = new Cesium.Cesium3DTileStyle({
    color: { conditions: [[`\${cell} === ${cell}`, "color('red')"], ["true", "color('white')"]] },
  });
  for (let i = 0; i < 5; i++) frame();
  const coloured = reddish();
  scene.primitives.remove(set);
  return { failed, files, triangles, picks, ...coloured };
};
window.version = Cesium.VERSION;
window.ready = true;
