// Opens the set that the server holds, or says why it cannot.
import { App } from "./app.js";
import { AT_ONCE, Blocks } from "./blocks.js";
import { boxOf, framed } from "./camera.js";
import { MOST, clipOf, viewOf } from "./director.js";
import { decode, parts } from "./link.js";
import { cover, note, over, trouble } from "./messages.js";
import { Picture } from "./picture.js";
import { Refused, Server } from "./server.js";
import { State, fresh } from "./state.js";
import { Things } from "./things.js";
import { Tree } from "./tree.js";
import { by } from "./dom.js";
import { cross, dot } from "./vector.js";

/** Blocks that cannot be read and are named, at most. */
const NAMED = 3;

let ready;
let failed;
const opened = new Promise((resolve, reject) => {
  [ready, failed] = [resolve, reject];
});
opened.catch(() => {});
let app = null;

async function open() {
  const { token, text } = parts(location.hash);
  if (!token) {
    throw new Refused(401, "This address is not complete: open the one that alvis view prints in the terminal, with all that follows the #.");
  }
  const server = new Server(token, (message) => trouble("set", message));
  // the graphics card gets ready while the server answers
  const asked = Promise.all([server.set(), server.tree()]);
  asked.catch(() => {});
  const picture = openPicture();
  const [set, words] = await asked;
  set.mirrored = dot(set.directions[0], cross(set.directions[1], set.directions[2])) < 0;
  const tree = new Tree(words, set);
  if (tree.nodes.length === 0) {
    throw new Refused(0, `${set.name} has no surface: nowhere in the volume do values pass the threshold ${set.threshold}.`);
  }
  const kept = decode(text);
  const start = kept ?? fresh();
  const box = boxOf(set);
  const { clientWidth: width, clientHeight: height } = by("stage");
  if (!kept) start.camera = framed(start.camera, box, width / height);
  const things = new Things(server, set);
  const early = askEarly(server, tree, set, start, things);
  picture.set = set;
  const blocks = new Blocks(picture.gl, server, set, early, { arrived: () => app.director.redraw(), failed: (_, error) => refuse(error) });
  app = new App({ server, set, tree, picture, blocks, things, state: new State(start), token });
  watchContext(app);
  watchLink(app);
  cover(null);
  await app.begin();
  if (!kept && text) note(UNKNOWN);
  app.director.ready.then(ready);
}

// The nearest blocks and the ids are on their way while the page is built.
function askEarly(server, tree, set, start, things) {
  things.ids(start.kind).catch(() => {});
  const { clientWidth: width, clientHeight: height } = by("stage");
  const view = viewOf(start.camera, set, [width, height]);
  const { wanted } = tree.cut(tree.sight(view, clipOf(start.clip)), { triangles: MOST, bytes: set.gpu_memory });
  const early = new Map();
  const first = new Set(wanted.flatMap(({ node }) => [rootOf(node), node]));
  for (const node of [...first].slice(0, AT_ONCE)) {
    const answer = server.tile(node);
    answer.catch(() => {});
    early.set(node, answer);
  }
  return early;
}

// The coarsest block above one: a first picture of all that it stands for.
function rootOf(node) {
  let top = node;
  while (top.parent) top = top.parent;
  return top;
}

function openPicture() {
  try {
    return new Picture(by("picture"));
  } catch (error) {
    if (error.message !== "no WebGL2") throw error;
    throw new Refused(0, "This browser does not draw in three dimensions: WebGL2 is missing or turned off. Current versions of Firefox, Chrome, Edge and Safari have it.");
  }
}

// What is wrong with blocks that cannot be read.
const wrong = new Set();

// A block that cannot be read, a server that is gone, a set that is another one now.
function refuse(error) {
  if (error.status === 0) {
    trouble("server", error.message, { text: "Try again", run: again });
  } else if (error.status !== 409) {
    wrong.add(error.message);
    const more = wrong.size > NAMED ? [`and ${wrong.size - NAMED} more`] : [];
    trouble("block", [...[...wrong].slice(0, NAMED), ...more].join("; "), { text: "Try again", run: again });
  }
  app.director.redraw();
}

function again() {
  for (const name of ["server", "block"]) over(name);
  wrong.clear();
  for (const node of app.tree.nodes) node.refused = null;
  app.director.redraw();
}

// What was on the card is lost when the driver starts anew; all of it is asked for again.
function watchContext({ picture, blocks, director, section, upload }) {
  const canvas = by("picture");
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault();
    trouble("card", "The graphics card was started anew. The picture comes back by itself; if it does not, load the page again.", {
      text: "Load again", run: () => location.reload(),
    });
  });
  canvas.addEventListener("webglcontextrestored", () => {
    blocks.forget();
    picture.build();
    upload.call(app);
    section.slice.key = "";
    section.update();
    over("card");
    director.forget();
  });
}

const UNKNOWN = "The link tells of no view: it may be cut short. This is the usual view.";

// Somebody puts another link of the same server into the address.
function watchLink({ state, token }) {
  addEventListener("hashchange", () => {
    const link = parts(location.hash);
    const then = decode(link.text);
    if (link.token !== token) location.reload();
    else if (then) state.restore(then);
    else if (link.text) note(UNKNOWN);
  });
}

/** What tests may read; nothing here changes the page. */
window.alvis = Object.freeze({
  ready: opened,
  get phase() { return app?.director.phase ?? "waiting"; },
  get draws() { return app?.picture.counts.draws; },
  get triangles() { return app?.picture.counts.triangles; },
  get visible() { return app?.director.told().visible; },
  get requests() { return app?.server.counts.requests; },
  get bytes() { return app?.server.counts.bytes; },
  get aborted() { return app?.server.counts.aborted; },
  get uploaded() { return app?.blocks.uploaded; },
  get onCard() { return app?.blocks.bytes; },
  get things() { return app.look.shown; },
  get chosen() { return [...app.choice.ids]; },
  get state() { return structuredClone(app.state.now); },
  get link() { return app.link(); },
  pick(x, y) { return app.under(x, y); },
  backFaces() { return app.picture.backFaces(); },
});

open().catch((error) => {
  console.error(error);
  const known = error instanceof Refused;
  cover(known ? error.message : "Something went wrong in this page.", known ? "" : String(error.message));
  failed(error);
});
