// How the values of a column are spread, with a brush that chooses.
import { h } from "./dom.js";
import { digitsBetween, many, number } from "./format.js";
import { barColour, shares } from "./look.js";

const BINS = 64;

/** Counts of values in even steps between two ends, on a line or a logarithmic one. */
export function counted(values, use, { low, high, log }) {
  const share = shares({ low, high, log });
  const bins = new Uint32Array(BINS);
  for (let i = 0; i < values.length; i++) {
    if (!use(i) || !Number.isFinite(values[i]) || (log && values[i] <= 0)) continue;
    const at = Math.floor(share(values[i]) * BINS);
    if (at >= 0 && at <= BINS) bins[Math.min(at, BINS - 1)]++;
  }
  return bins;
}

function valueAt({ least, most, log }, share) {
  return log ? least * (most / least) ** share : least + share * (most - least);
}

/** The least, the middle and the largest value of a bar; those of the outermost are the ends, whatever rounding does. */
function barOf(data, i) {
  const at = (k) => valueAt(data, k / BINS);
  return [i === 0 ? data.least : at(i), at(i + 0.5), i === BINS - 1 ? data.most : at(i + 1)];
}

export class Histogram {
  /** `brushed(low, high)` is called with the ends of what was brushed, or with null for a click. */
  constructor(brushed) {
    this.canvas = h("canvas", { role: "img", ariaLabel: "Distribution. Drag across it to choose" });
    this.element = h("div", { className: "histogram" }, this.canvas);
    this.brushed = brushed;
    this.data = null;
    this.brush = null;
    this.canvas.addEventListener("pointerdown", (e) => this.down(e));
    this.canvas.addEventListener("pointermove", (e) => this.move(e));
    this.canvas.addEventListener("pointerup", () => this.up());
    new ResizeObserver(() => this.draw()).observe(this.element);
  }

  /** `data`: {bins, least, most, log, colour(least, middle, largest) of a bar or null}, or {only: text} where there is nothing to spread. */
  show(data) {
    this.data = data;
    this.draw();
  }

  clearBrush() {
    this.brush = null;
    this.draw();
  }

  share(event) {
    const box = this.canvas.getBoundingClientRect();
    return Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
  }

  value(share) {
    return valueAt(this.data, share);
  }

  /** The value at a share of the way, as text. */
  told(share) {
    const { least, most } = this.data;
    return number(share === 1 ? most : this.value(share), digitsBetween(least, most, 3));
  }

  down(event) {
    if (!this.data?.bins) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.from = this.share(event);
  }

  move(event) {
    if (!this.data?.bins) return;
    if (this.from === undefined) {
      const bin = Math.min(Math.floor(this.share(event) * BINS), BINS - 1);
      const ends = [bin / BINS, (bin + 1) / BINS].map((s) => this.told(s));
      this.canvas.title = `${many(this.data.bins[bin], this.data.one, this.data.more)} from ${ends[0]} to ${ends[1]}`;
      return;
    }
    const to = this.share(event);
    this.brush = [Math.min(this.from, to), Math.max(this.from, to)];
    this.draw();
  }

  up() {
    if (this.from === undefined) return;
    this.from = undefined;
    if (this.brush && this.brush[1] - this.brush[0] > 0.004) {
      const ends = this.brush.map((s) => Number(this.value(s).toPrecision(digitsBetween(this.data.least, this.data.most, 6))));
      // an end of the brush at the end of the values takes what rounding would leave out
      this.brushed(this.brush[0] <= 0 ? null : ends[0], this.brush[1] >= 1 ? null : ends[1]);
    } else {
      this.brush = null;
      this.draw();
      this.brushed();
    }
  }

  draw() {
    const { canvas, data } = this;
    const ratio = window.devicePixelRatio;
    const [width, height] = [this.element.clientWidth, this.element.clientHeight];
    if (width === 0) return;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const [text, soft, accent] = ["--text", "--soft", "--accent"].map((n) => style.getPropertyValue(n));
    context.font = "13px system-ui, 'Liberation Sans', sans-serif";
    context.fillStyle = soft;
    if (!data) return;
    if (data.only) {
      context.fillText(data.only, 2, height / 2);
      return;
    }
    const floor = height - 20;
    const most = Math.max(...data.bins, 1);
    const step = width / BINS;
    data.bins.forEach((n, i) => {
      context.fillStyle = data.colour ? `rgb(${data.colour(...barOf(data, i)).join()})` : soft;
      const tall = n === 0 ? 0 : Math.max((n / most) * (floor - 4), 1.5);
      context.fillRect(i * step + 0.5, floor - tall, step - 1, tall);
    });
    context.fillStyle = soft;
    context.fillRect(0, floor, width, 1);
    context.fillStyle = text;
    context.fillText(this.told(0), 0, height - 4);
    context.textAlign = "center";
    context.fillText(this.told(0.5), width / 2, height - 4);
    context.textAlign = "right";
    context.fillText(this.told(1), width, height - 4);
    if (this.brush) {
      const [a, b] = this.brush.map((s) => s * width);
      context.globalAlpha = 0.25;
      context.fillStyle = accent;
      context.fillRect(a, 0, b - a, floor);
      context.globalAlpha = 1;
      context.fillRect(a - 1, 0, 2, floor);
      context.fillRect(b - 1, 0, 2, floor);
    }
  }
}

/** What the histogram shows of a column: its values from the least to the largest of what is shown. */
export function spread(values, use, { log, scale, one, more }) {
  let [least, most] = [Infinity, -Infinity];
  for (let i = 0; i < values.length; i++) {
    const v = values[i];
    if (!use(i) || !Number.isFinite(v) || (log && v <= 0)) continue;
    least = Math.min(least, v);
    most = Math.max(most, v);
  }
  if (!(least < most)) return { only: least === most ? `All have ${number(least)}.` : "There are no values." };
  const bins = counted(values, use, { low: least, high: most, log });
  return { bins, least, most, log, one, more, colour: barColour(scale) };
}
