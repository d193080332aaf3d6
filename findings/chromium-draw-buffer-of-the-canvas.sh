#!/usr/bin/env bash
# Chromium 153 (@sparticuz/chromium 153.0.0, driven by playwright-core 1.65.1): a WebGL2 canvas stays black for good once
# a texture is deleted whose framebuffer is bound for reading only.
#
# Expected: OpenGL ES 3.0, section 4.2.1: draw buffers are a state of the framebuffer that is bound for drawing when
#   drawBuffers is called; that of the canvas is BACK. Appendix D.1.2: a deleted texture is detached from the framebuffers
#   that are bound. Nothing there touches the draw buffers of another framebuffer.
# Seen: a framebuffer for which drawBuffers was called is bound to READ_FRAMEBUFFER, the canvas to DRAW_FRAMEBUFFER, as
#   after a blitFramebuffer to the canvas. Deleting the texture of the framebuffer, or detaching it, sets the draw buffer
#   of the canvas to NONE: all that is drawn to the canvas is lost, at another size as well. getParameter still tells
#   BACK, and there is no error. drawBuffers([BACK]) mends it. It does not happen if the framebuffer is deleted before its
#   texture, is bound for reading no longer or for drawing too, or never had a call of drawBuffers. It is the same with
#   SwiftShader and Mesa (llvmpipe) and in Chromium 156. WebGLFramebuffer::RemoveAttachmentInternal leaves out buffers
#   without an image by DrawBuffersEXT, which sets them for what is bound for drawing, whatever it was detached from.
# Why it matters: a viewer that draws into textures, blits them to the canvas, and frees them when the window changes its
#   size shows nothing from then on, without a word of why.
#
# CHROMIUM=/usr/bin/chromium looks at another build.
set -euo pipefail
command -v npm >/dev/null || { echo "this one needs node and npm" >&2; exit 2; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
export TMPDIR=$work
npm install --silent --no-audit --no-fund @sparticuz/chromium@153.0.0 playwright-core@1.65.1 >/dev/null
cat >page.html <<'EOF'
<!DOCTYPE html><title>draw buffer of the canvas</title>
<script>
const CASES = {
  "texture deleted": (gl, frame, texture) => gl.deleteTexture(texture),
  "texture detached": (gl) => gl.framebufferTexture2D(gl.READ_FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, null, 0),
  "framebuffer deleted first": (gl, frame, texture) => { gl.deleteFramebuffer(frame); gl.deleteTexture(texture); },
  "unbound first": (gl, frame, texture) => { gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null); gl.deleteTexture(texture); },
  "bound for drawing too": (gl, frame, texture) => { gl.bindFramebuffer(gl.FRAMEBUFFER, frame); gl.deleteTexture(texture); },
  "drawBuffers never called": (gl, frame, texture) => gl.deleteTexture(texture),
};
function look(name) {
  const canvas = document.createElement("canvas"), gl = canvas.getContext("webgl2");
  let shade = 0;
  const draws = () => { // clears the canvas to a shade that it did not have, and reads that
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    shade += 51;
    gl.clearColor(shade / 255, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    const pixel = new Uint8Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return pixel[0] === shade;
  };
  const texture = gl.createTexture(), frame = gl.createFramebuffer();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, 8, 8);
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
  if (name !== "drawBuffers never called") gl.drawBuffers([gl.COLOR_ATTACHMENT0]);
  const before = draws();
  gl.bindFramebuffer(gl.READ_FRAMEBUFFER, frame); // the canvas stays bound for drawing
  CASES[name](gl, frame, texture);
  const after = draws(), told = gl.getParameter(gl.DRAW_BUFFER0) === gl.BACK && gl.getError() === gl.NO_ERROR;
  canvas.width += 10;
  const resized = draws();
  gl.drawBuffers([gl.BACK]);
  return { before, after, resized, mended: draws(), told };
}
</script>
EOF
cat >look.mjs <<'EOF'
import packaged from "@sparticuz/chromium";
import { chromium } from "playwright-core";

const LOADS = 5;
const args = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? (await packaged.executablePath()), args });
console.log(`Chromium ${browser.version()}, canvas draws in how many of ${LOADS} loads: before, after, resized, after drawBuffers([BACK])`);
const seen = {};
for (let i = 0; i < LOADS; i++) {
  const tab = await browser.newPage();
  await tab.goto(new URL("page.html", import.meta.url).href);
  const load = await tab.evaluate(() => Object.fromEntries(Object.keys(CASES).map((name) => [name, look(name)])));
  for (const [name, one] of Object.entries(load)) {
    const sum = (seen[name] ??= { before: 0, after: 0, resized: 0, mended: 0, told: 0 });
    for (const key of Object.keys(sum)) sum[key] += one[key];
  }
  await tab.close();
}
await browser.close();
const lost = ["texture deleted", "texture detached"];
let same = true;
for (const [name, { before, after, resized, mended, told }] of Object.entries(seen)) {
  console.log(`${name}: ${before}, ${after}, ${resized}, ${mended}; tells BACK and no error in ${told}`);
  const drawn = lost.includes(name) ? 0 : LOADS;
  same &&= before === LOADS && after === drawn && resized === drawn && mended === LOADS && told === LOADS;
}
if (!same) {
  console.log("changed: no longer as recorded above");
  process.exit(1);
}
EOF
node look.mjs
