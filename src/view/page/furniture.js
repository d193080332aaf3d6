// What stands over the picture, on the screen and in a saved one: the scale bar, the legend, the directions.
import { BEST, WORST, mapped } from "./colours.js";
import { digitsBetween, logTicks, number, round125, ticks, unit, withUnit } from "./format.js";
import { axes } from "./camera.js";
import { shares } from "./look.js";

const FONT = "system-ui, 'Segoe UI', 'Liberation Sans', sans-serif";
const DARK = { text: "#eceff3", ground: "rgb(20 23 28 / 72%)", line: "#eceff3" };
const LIGHT = { text: "#161a20", ground: "rgb(255 255 255 / 78%)", line: "#161a20" };
const AXIS = { dark: ["#ff7b72", "#7ee787", "#79b8ff"], light: ["#c4261d", "#1a7f37", "#0b63ce"] };

/**
 * Draws on a 2D context whose unit is a pixel of the layout. `what` has the sizes `width` and `height`, `dark`, `scale`
 * (of the look), `camera`, `mirrored`, `pixel` (length of a pixel where the camera looks), `unit`.
 */
export function furnish(context, what) {
  const look = what.dark ? DARK : LIGHT;
  scaleBar(context, what, look);
  if (what.scale) legend(context, what, look);
  directions(context, what);
}

function plate(context, x, y, width, height, look) {
  context.fillStyle = look.ground;
  context.beginPath();
  context.roundRect(x, y, width, height, 6);
  context.fill();
}

/** Length and text of the bar: a round number of about a fifth of the picture. */
export function bar({ width, pixel, unit: name }) {
  const length = round125(Math.min(width * 0.22, 260) * pixel);
  const voxels = name === "voxel";
  return { length, text: `${number(length)} ${voxels ? (length === 1 ? "voxel" : "voxels") : unit(name)}` };
}

function scaleBar(context, what, look) {
  const { length, text } = bar(what);
  const long = length / what.pixel;
  const [x, y] = [24, what.height - 24];
  context.font = `600 15px ${FONT}`;
  plate(context, x - 10, y - 32, Math.max(long, context.measureText(text).width) + 20, 44, look);
  context.fillStyle = look.text;
  context.textAlign = "left";
  context.textBaseline = "alphabetic";
  context.fillText(text, x, y - 12);
  context.strokeStyle = look.line;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(x, y - 5);
  context.lineTo(x, y + 3);
  context.moveTo(x, y - 1);
  context.lineTo(x + long, y - 1);
  context.moveTo(x + long, y - 5);
  context.lineTo(x + long, y + 3);
  context.stroke();
}

function legend(context, what, look) {
  const wide = 250;
  const [x, y] = [what.width - wide - 28, what.height - 76];
  plate(context, x - 14, y - 6, wide + 28, 70, look);
  context.fillStyle = look.text;
  context.textBaseline = "alphabetic";
  context.textAlign = "left";
  context.font = `600 14px ${FONT}`;
  if (what.scale.by === "best") {
    context.fillText(`${what.scale.count} best and worst by form factor`, x, y + 14, wide);
    [[BEST, "best"], [WORST, "worst"]].forEach(([colour, text], i) => {
      context.fillStyle = `rgb(${colour.rgb.join()})`;
      context.fillRect(x + 110 * i, y + 30, 20, 16);
      context.fillStyle = look.text;
      context.font = `14px ${FONT}`;
      context.fillText(text, x + 110 * i + 28, y + 43);
    });
    return;
  }
  const { low, high, log, least, most, column, map } = what.scale;
  context.fillText(withUnit(column) + (log ? ", log" : ""), x, y + 14, wide);
  for (let i = 0; i < wide; i++) {
    context.fillStyle = `rgb(${mapped(map, i / (wide - 1)).join()})`;
    context.fillRect(x + i, y + 22, 1.5, 14);
  }
  context.font = `13px ${FONT}`;
  context.fillStyle = look.text;
  context.textAlign = "center";
  const [a, b] = [Math.min(low, high), Math.max(low, high)];
  const share = shares({ low, high, log });
  const marks = log ? logTicks(a, b) : ticks(a, b, 5);
  const digits = digitsBetween(a, b, 3);
  let free = -Infinity;
  for (const mark of marks.sort((p, q) => share(p) - share(q))) {
    const at = x + share(mark) * wide;
    const half = context.measureText(number(mark, digits)).width / 2;
    context.fillRect(at - 0.5, y + 36, 1, 4);
    if (at - half < free + 6) continue;
    context.fillText(number(mark, digits), at, y + 54);
    free = at + half;
  }
  // what lies beyond the ends has their colours
  const beyond = [[least < a, low < high ? 0 : 1], [most > b, low < high ? 1 : 0]];
  for (const [is, end] of beyond) {
    if (!is) continue;
    const [at, way] = end === 0 ? [x, -1] : [x + wide, 1];
    context.fillStyle = `rgb(${mapped(map, end).join()})`;
    context.beginPath();
    context.moveTo(at, y + 22);
    context.lineTo(at + 9 * way, y + 29);
    context.lineTo(at, y + 36);
    context.fill();
  }
}

function directions(context, what) {
  const { right, up, back } = axes(what.camera);
  const [x, y, size] = [what.width - 52, 56, 30];
  const ends = [0, 1, 2].map((k) => ({ k, x: right[k] * (what.mirrored ? -1 : 1), y: -up[k], depth: back[k] }));
  ends.sort((a, b) => a.depth - b.depth);
  context.lineWidth = 2.5;
  context.font = `600 14px ${FONT}`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  for (const end of ends) {
    context.strokeStyle = context.fillStyle = AXIS[what.dark ? "dark" : "light"][end.k];
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + end.x * size, y + end.y * size);
    context.stroke();
    context.fillText("xyz"[end.k], x + end.x * (size + 11), y + end.y * (size + 11));
  }
  context.textBaseline = "alphabetic";
}
