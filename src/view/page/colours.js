// Colours: maps from numbers to colours, and those that things are painted in.

// Each map at 33 even steps, six digits a step; what lies between is mixed.
const STEPS = 32;
const MAPS = {
  viridis:
    "440154470d6048186a482374472d7b4537814240863e49893b528b375b8d33638d2f6b8e2c728e297a8e26828e23898e219" +
    "18c1f978b1f9f8821a68527ad8131b57b3dbc744cc26c5cc8636ece5881d34d95d840aadc32c0df25d5e21aeae51afde725",
  magma:
    "0000040303120a0822130d341d114729115a36106b440f7651127c5d177f6a1c81762181832681902a819c2e7faa337db73" +
    "779c23b75cf4070db476ae55064ee5b5ef4695cf9785dfb8761fd9668fea571feb47bfec287fed194fde0a1fceeb0fcfdbf",
  plasma:
    "0d08872206903105973f049c4c02a15901a56600a77201a87e03a88a09a59511a1a01a9caa2395b32c8ebc3587c43e7fcc4" +
    "778d24f71d9586adf6263e56b5deb7556f07f4ff48948f89441fb9f3afdab33feb72dfdc328fcd025f9dd25f5eb27f0f921",
  inferno:
    "0000040403120b0724150b37210c4a2f0a5b3d09654a0c6b57106e64156e71196e7d1e6d8a226a972766a32c61b0315bbc3" +
    "754c63d4dd04545da4e3ce35933eb6429f1711ff67e14f98c0afb9b06fcaa0ffbba1ff9c932f5d949f2e865f3f586fcffa4",
  cividis:
    "00205100255c012b6408306911366c1b3c6d26416d31476d3c4d6d46526d50586d595e6d62646e6a696f716f717875737f7" +
    "b748581768c8777928d78999478a19a77a9a176b1a774baae70c4b56ccebc67d8c361e2cb5bebd255f3da4ef9e149fde945",
  turbo:
    "22171b3d2971493eae4a53d64469ee3b7ff83294f72aa9ef25bce125cdcf29dcbb31e8a73ff29350f97f65fc6e7cfd5e94f" +
    "a50adf445c4eb3bdadf33ecd02dfabf28ffac24ff9720ff821dfc6b19ef5615de4111ca2e0cb61e07a31202950c00900c00",
};

export const MAP_NAMES = Object.keys(MAPS);

const stops = new Map();

/** The colour [r, g, b] of 0 to 255 at a share from 0 (the map's first) to 1 (its last). */
export function mapped(name, share) {
  if (!stops.has(name)) {
    stops.set(name, Array.from({ length: STEPS + 1 }, (_, i) => parse(MAPS[name].slice(6 * i, 6 * i + 6))));
  }
  const list = stops.get(name);
  const at = Math.min(Math.max(share, 0), 1) * STEPS;
  const i = Math.min(Math.floor(at), STEPS - 1);
  return [0, 1, 2].map((k) => Math.round(list[i][k] + (at - i) * (list[i + 1][k] - list[i][k])));
}

function parse(hex) {
  return [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16));
}

/** [r, g, b] of `#rrggbb`. */
export function rgb(hex) {
  return parse(hex.slice(1));
}

export function isColour(text) {
  return typeof text === "string" && /^#[0-9a-f]{6}$/.test(text);
}

/** What one paints with: apart from each other for most eyes, on dark and on light. */
export const PAINTS = ["#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7", "#ffffff"];

const named = (hex) => ({ hex, rgb: rgb(hex) });

/** The best, the worst, and what is marked. */
export const BEST = named("#1a9850");
export const WORST = named("#e0342b");
export const MARK = named("#ff9500");
/** What has no value in the column that colours, and what is not painted beside things that are. */
export const EMPTY = [150, 153, 158];
