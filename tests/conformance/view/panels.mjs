// What is asked of cut faces, of the panels beside the picture, and of the keyboard.
import assert from "node:assert/strict";
import fs from "node:fs";
import path from "node:path";
import { follow, points } from "./look.mjs";
import { copiedCommand, count, nap, onScreen, paintedBy, rows, seen, selectedBy } from "./parts.mjs";
import { decode } from "./session.mjs";
import { manifestOf, middles } from "./set.mjs";

const [BACK, FRONT] = [128, 255];
const CUT = [0.45, 0.48, 0.53].map((x) => x * 255);
const KINDS = ["Cells", "Objects", "Surfaces"];
const COLOURINGS = ["Plain", "By value", "Best and worst"];
const SIZES = [[1280, 720], [1920, 1080], [900, 700], [420, 800]];

// How many points of a picture show a kind of face, how many of them one colour all around, and how many that of a cut.
async function flat(session, face, cut = () => CUT) {
  await session.tab.evaluate(() => {
    document.getElementById("handle").style.visibility = "hidden";
  });
  const { data } = await decode(session.tab, await session.pixels());
  const size = await session.size();
  const at = (x, y) => [...data.subarray(4 * (y * size.width + x), 4 * (y * size.width + x) + 3)];
  const told = { seen: 0, flat: 0, cut: 0 };
  for (const [x, y] of points(size, 30, 20)) {
    const around = [[x, y], [x - 3, y], [x + 3, y], [x, y - 3], [x, y + 3]];
    const found = await session.tab.evaluate((list) => list.map(([a, b]) => window.alvis.pick(a, b)), around);
    if (!found.every((f) => f?.face === face && f.id === found[0].id)) continue;
    told.seen++;
    const colours = around.map(([a, b]) => at(a, b));
    if (colours.every((c) => c.join() === colours[0].join())) told.flat++;
    if (at(x, y).every((c, k) => Math.abs(c - cut(found[0].id)[k]) <= 2)) told.cut++;
  }
  return told;
}

// All but where lines of the section lie over it.
const mostly = ({ seen: all, cut }) => cut > 0.85 * all;

// Where material is cut there is a flat face in its colour; where something is left out, in that of what stays.
async function cutFaces({ open, at }) {
  const session = await open("blender");
  await session.key("c");
  for (const colouring of COLOURINGS) {
    await session.radio(colouring).click();
    await session.settle(400);
    const material = await flat(session, BACK);
    assert(material.seen > 30 && mostly(material), `${colouring}: ${JSON.stringify(material)}`);
    const hollows = await flat(session, FRONT);
    assert(hollows.flat < hollows.seen / 2, `${colouring}: ${JSON.stringify(hollows)} of hollows`);
    await session.chooseWhere("touches_border");
    await session.key("h", 400);
    await session.tab.fill("#list input[type=search]", "not touches_border");
    await nap(700);
    const own = new Map((await allRows(session)).map((row) => [row.id, row.colour]));
    const bodies = await flat(session, FRONT, (id) => own.get(id).map((c) => 0.8 * c));
    assert(bodies.seen > 4 && mostly(bodies), `${colouring}: ${JSON.stringify(bodies)} of what stays`);
    const outsides = await flat(session, BACK);
    assert(outsides.flat < outsides.seen / 2, `${colouring}: ${JSON.stringify(outsides)} of outsides`);
    await session.key("Alt+h", 400);
  }
  // from inside one sees the wall
  await session.key("c");
  const [target] = middles(at("blender"), 1);
  await follow(session, { target, distance: 0.02, azimuth: 1, elevation: 0.3 });
  await session.chooseWhere("touches_border");
  await session.key("h", 400);
  const walls = await flat(session, FRONT);
  assert(walls.seen > 60 && walls.flat < walls.seen / 2, `${JSON.stringify(walls)} from inside`);
  await session.close();
  const noise = await open("noise");
  await noise.radio(/Objects/).click();
  await noise.settle(400);
  await noise.chooseWhere("id > 1");
  await noise.key("h", 400);
  await noise.key("c");
  await noise.tab.fill("#list input[type=search]", "id == 1");
  await nap(700);
  const [one] = await rows(noise);
  const material = await flat(noise, BACK, () => one.colour.map((c) => 0.8 * c));
  assert(material.seen > 10 && mostly(material), `${JSON.stringify(material)} of an object`);
  await noise.close();
}

// All rows of the list, scrolled through.
async function allRows(session) {
  const found = new Map();
  for (let top = 0; ; top += 100) {
    const more = await session.tab.evaluate((to) => {
      const body = document.querySelector(".grid-body");
      body.scrollTop = to;
      return body.scrollTop === to;
    }, top);
    await nap(40);
    for (const row of await rows(session)) found.set(row.id, row);
    if (!more) return [...found.values()];
  }
}

// Hollows that material hides from all sides are shown through it, in their colours, and can be chosen; a section opens it.
async function buried({ open }) {
  const session = await open("cast");
  await session.radio("By value").click();
  await session.tab.selectOption("#colour select[aria-label=Column]", "voxels");
  await session.settle(400);
  const picked = new Set();
  for (const [x, y] of points(await session.size(), 30, 20)) {
    const found = await session.pick(x, y);
    if (found) picked.add(found.id);
  }
  assert(picked.size >= 4 && !picked.has(0), `picked: ${[...picked]}`);
  const bodies = await flat(session, BACK);
  assert(bodies.seen > 10 && bodies.flat < bodies.seen / 2 && bodies.cut === 0, JSON.stringify(bodies));
  for (const kind of ["Objects", "Surfaces"]) {
    await session.radio(new RegExp(kind)).click();
    await session.settle(400);
    const shaded = await flat(session, BACK);
    assert(shaded.seen > 10 && shaded.flat < shaded.seen / 2, `${kind}: ${JSON.stringify(shaded)}`);
  }
  await session.radio(/Cells/).click();
  await session.key("c", 400);
  const material = await flat(session, BACK);
  assert(material.seen > 30 && mostly(material), `cut: ${JSON.stringify(material)}`);
  await session.close();
}

// Two clicks on a row tell all of it, though the first makes the row anew.
async function rowTwice({ open }) {
  const session = await open("blender");
  const row = session.tab.locator(".grid-row").nth(3);
  const id = await row.getAttribute("data-id");
  await row.dblclick();
  await session.until((n) => document.querySelector("#info h2")?.innerText === `Cell ${n}`, id);
  await session.settle(300);
  const { camera } = await session.get("state");
  await session.tab.locator(".grid-row").nth(4).click();
  await nap(300);
  assert.deepEqual((await session.get("state")).camera, camera, "one click does not fly");
  await session.close();
}

// What is ranked is told, and is what the panel shows.
async function ranking({ open, run, at }) {
  const session = await open("blender");
  await session.radio("Best and worst").click();
  await session.settle(400);
  const ranked = count(run, at("blender"), "not missing(form_factor)");
  const text = await session.tab.innerText("#colour");
  assert(ranked < 200, "the set is one with fewer than are asked for");
  for (const part of [`${ranked} of ${await session.get("things")}`, `best: ${ranked >> 1}`]) assert(text.includes(part), text);
  assert.equal(await session.tab.locator("#colour select").count(), 0, "no other column can be chosen beside the ranking");
  // the distribution is that of the form factor: a brush over all of it chooses what has one
  const box = await session.tab.locator(".histogram").boundingBox();
  await session.tab.mouse.move(box.x + box.width / 2, box.y + 20);
  await session.tab.mouse.down();
  await session.tab.mouse.move(box.x + box.width + 5, box.y + 20, { steps: 4 });
  await session.tab.mouse.up();
  await nap(400);
  await session.key("m", 400);
  const [rule] = (await session.get("state")).rules.cells;
  assert(/^form_factor >= /.test(rule.where), rule.where);
  // and another colouring shows the column that it says
  await session.radio("By value").click();
  await session.settle(400);
  const { by, column } = (await session.get("state")).colour.cells;
  assert.equal(by, "column");
  assert.equal(await session.tab.inputValue("#colour select[aria-label=Column]"), column);
  await session.tab.selectOption("#colour select[aria-label=Column]", "area");
  await session.radio("Best and worst").click();
  await session.settle(400);
  await session.radio("By value").click();
  await session.settle(400);
  assert.equal(await session.tab.inputValue("#colour select[aria-label=Column]"), "area");
  await session.close();
}

// Of a scan that lies far from where its axes begin, places are told to a part of a voxel, as in the tables.
async function farAway({ open, run, at }) {
  const session = await open("far");
  const [head, ...lines] = fs.readFileSync(path.join(at("far"), "cells.csv"), "utf8").trim().split("\n").map((line) => line.split(","));
  const [id, x] = ["id", "centroid_x"].map((name) => head.findIndex((h) => h.split(" ")[0] === name));
  await session.chooseWhere("id == 30");
  await session.key("i");
  await session.until(() => document.querySelector("#info h2")?.innerText === "Cell 30");
  const told = await session.tab.locator("#info tr", { has: session.tab.locator("td[title^=centroid_x]") }).locator("td").last().innerText();
  const real = Number(lines.find((line) => line[id] === "30")[x]);
  assert(Math.abs(Number(told.split(",")[0]) - real) < 0.006, `${told}, ${real} in the table`);
  await session.key("Escape");
  await session.radio("By value").click();
  await session.tab.selectOption("#colour select[aria-label=Column]", "centroid_x");
  await session.settle(400);
  const box = await session.tab.locator(".histogram").boundingBox();
  await session.tab.mouse.move(box.x + box.width / 2, box.y + 20);
  await session.tab.mouse.down();
  await session.tab.mouse.move(box.x + box.width * 0.75, box.y + 20, { steps: 4 });
  await session.tab.mouse.up();
  await nap(400);
  await session.key("m", 400);
  const [rule] = (await session.get("state")).rules.cells;
  const [n, all] = [rule.where, "id > 0"].map((where) => count(run, at("far"), where));
  const within = lines.filter((line) => Number(line[x]) >= 123456.789 + 0.45 * 96 * 0.05 && Number(line[x]) <= 123456.789 + 0.8 * 96 * 0.05);
  assert(n > 5 && n < all && n <= within.length, `${n} of ${all}: ${rule.where}`);
  const { low, high } = (await copiedCommand(session)).match(/--range (?<low>\S+):(?<high>[^\s']+)/).groups;
  assert(low > 123456.7 && high < 123461.7 && high - low > 3, `${low} to ${high}`);
  await session.key("c");
  await session.tab.locator("#section").getByRole("radio", { name: "x", exact: true }).click();
  const place = Number(await session.tab.inputValue("#section input[type=text]"));
  assert(place > 123458 && place < 123461, `the section lies at ${place}`);
  await session.tab.fill("#section input[type=text]", "123458.5");
  await session.tab.keyboard.press("Enter");
  await session.settle(300);
  const { clip } = await session.get("state");
  assert(Math.abs(clip.at - 1.711) < 0.03, `a section at 123458.5 lies at ${clip.at}`);
  await session.close();
}

// The command makes what is shown, whatever was left out, and paints what the page paints.
async function commands({ open, run, at }) {
  for (const [set, conditions] of [["blender", ["volume > 0.2 and not touches_border", "volume < 0.1"]], ["noise", ["id > 2"]]]) {
    const session = await open(set);
    for (const kind of set === "noise" ? KINDS : ["Cells"]) {
      await session.radio(new RegExp(kind)).click();
      await session.settle(400);
      const same = async () => {
        const copied = await copiedCommand(session);
        const { totals } = manifestOf(selectedBy(copied, { run, at, to: "selected" }));
        assert.equal(totals[kind.toLowerCase()], await session.get("things"), copied);
      };
      await same();
      for (const condition of conditions) {
        await session.chooseWhere(condition);
        await session.key("h", 400);
        await same();
      }
      await session.key("Alt+h", 400);
      await session.chooseWhere("id < 40");
      await session.key("H", 400);
      await session.chooseWhere("id == 3 or id == 5");
      await session.key("h", 400);
      await same();
    }
    await session.close();
  }
  const session = await open("blender");
  await session.radio("Best and worst").click();
  await session.chooseWhere("form_factor > 0.9 and id > 30");
  await session.key("h", 400);
  const painted = paintedBy(await copiedCommand(session), { run, at, to: "painted_part" });
  for (const row of (await allRows(session)).filter((r) => !r.classes.includes("hidden-thing"))) {
    const q = painted.get(row.id) ?? [150, 153, 158];
    assert(row.colour.every((c, k) => Math.abs(c - q[k]) <= 4), `row ${row.id} is ${row.colour}, painted ${q}`);
  }
  await session.close();
}

// In windows of all sizes, what opens covers neither the picture nor what belongs to it.
async function layouts({ open }) {
  const session = await open("blender");
  const { tab } = session;
  const before = tab.viewportSize();
  const box = (selector) => tab.locator(selector).boundingBox();
  const apart = (a, b) => a.x + a.width <= b.x + 0.5 || b.x + b.width <= a.x + 0.5 || a.y + a.height <= b.y + 0.5 || b.y + b.height <= a.y + 0.5;
  await session.key("c");
  await session.radio("Best and worst").click();
  for (const [width, height] of SIZES) {
    const size = `${width} x ${height}`;
    await tab.setViewportSize({ width, height });
    await session.settle(400);
    const inside = (b) => b.x >= 0 && b.y >= 0 && b.x + b.width <= width && b.y + b.height <= height;
    for (const button of await tab.locator("header button:visible").all()) assert(inside(await button.boundingBox()), `${size}: ${await button.innerText()}`);
    await session.button("Share").click();
    const menu = await box(".menu > .pop:not([hidden])");
    assert(inside(menu) && apart(menu, await box("#section")), `${size}: the menu covers the section, or is cut off`);
    await tab.keyboard.press("Escape");
    await session.chooseWhere("id == 30");
    await session.key("i");
    await session.until(() => document.querySelector("#info h2")?.innerText === "Cell 30");
    await session.settle(300);
    const [info, picture] = [await box("#info"), await box("#picture")];
    assert(apart(info, picture), `${size}: details cover the picture`);
    assert(picture.width >= 0.5 * Math.min(width, 800) && picture.height >= 280, `${size}: the picture is ${picture.width} x ${picture.height}`);
    await session.button("Columns").scrollIntoViewIfNeeded();
    await session.button("Columns").click();
    assert(inside(await box(".menu > .pop:not([hidden])")), `${size}: the columns are cut off`);
    await tab.keyboard.press("Escape");
    const handle = await tab.evaluate(() => document.documentElement.scrollWidth > innerWidth || document.documentElement.scrollHeight > innerHeight);
    assert(!handle, `${size}: the page is larger than the window`);
    await session.key("Escape");
    await session.key("Escape");
    await tab.keyboard.press("?");
    const columns = await tab.locator("#help .columns > div").evaluateAll((all) => new Set(all.map((e) => e.offsetLeft)).size);
    assert.equal(columns, width >= 800 ? 2 : 1, `${size}: columns of the help`);
    await tab.keyboard.press("?");
  }
  await tab.setViewportSize(before);
  await session.close();
}

// Each control is reached with the Tab key and shows that it is, in dark and in light.
async function keyboard({ open }) {
  for (const dark of [true, false]) {
    const session = await open("blender", { dark });
    const { tab } = session;
    await session.key("c");
    await session.chooseWhere("id == 7");
    await session.key("i", 400);
    const wanted = await tab.evaluate(() => {
      const all = [...document.querySelectorAll("button, input, select, [tabindex='0']")];
      return all.filter((e) => !e.disabled && e.tabIndex >= 0 && e.checkVisibility()).map((e, i) => (e.dataset.number = i)).length;
    });
    assert(wanted > 25, `${wanted} controls`);
    const reached = new Map();
    for (let i = 0; i < wanted + 8; i++) {
      await tab.keyboard.press("Tab");
      const at = await tab.evaluate(() => {
        const e = document.activeElement;
        const { outlineStyle, outlineWidth } = getComputedStyle(e);
        return { number: e.dataset.number, name: e.innerText || e.ariaLabel || e.id, seen: outlineStyle !== "none" && parseFloat(outlineWidth) >= 1 };
      });
      if (at.number !== undefined) reached.set(at.number, at);
    }
    assert.equal(reached.size, wanted, "not all controls are reached");
    for (const { name, seen: shows } of reached.values()) assert(shows, `nothing shows that ${name} has the keyboard`);
    await session.close();
  }
  const session = await open("blender");
  const { tab } = session;
  const held = () => tab.evaluate(() => document.activeElement.innerText || document.activeElement.ariaLabel);
  // what is pressed keeps the keyboard when its panel is made anew
  await session.radio("By value").focus();
  await tab.keyboard.press("Enter");
  await session.settle(400);
  assert.equal((await session.get("state")).colour.cells.by, "column");
  assert.equal(await held(), "By value");
  // a menu opens, is walked through, and gives the keyboard back
  await session.button("Share").focus();
  await tab.keyboard.press("Enter");
  assert.equal(await held(), "Save picture …");
  await tab.keyboard.press("Escape");
  assert.equal(await held(), "Share");
  assert.equal(await tab.locator(".menu > .pop:not([hidden])").count(), 0);
  // a sheet keeps it, and what lies behind gets no keys
  await session.key("s");
  const { camera } = await session.get("state");
  for (let i = 0; i < 8; i++) {
    await tab.keyboard.press("Tab");
    assert(await tab.evaluate(() => document.activeElement === document.body || document.getElementById("save").contains(document.activeElement)));
  }
  await tab.keyboard.press("x");
  await tab.keyboard.press("Escape");
  await session.settle(300);
  assert.equal(await tab.locator("dialog[open]").count(), 0);
  assert.deepEqual((await session.get("state")).camera, camera);
  // rows with the arrows, and what is known of one
  await tab.locator(".grid-body").focus();
  for (const key of ["ArrowDown", "ArrowDown", "Enter"]) await tab.keyboard.press(key);
  await session.until(() => document.querySelector("#info h2")?.innerText === "Cell 2");
  await session.close();
}

// Tables that somebody changed, and one beside them that is damaged.
async function tables({ open, at }) {
  const renamed = await open("renamed");
  await renamed.until(() => document.querySelectorAll(".grid-row").length > 3);
  assert(await renamed.tab.locator("#list .wrong-text").isHidden());
  await renamed.tab.selectOption("#colour select[aria-label=Column]", "mine");
  await renamed.settle(400);
  assert.equal((await renamed.get("state")).colour.cells.column, "mine");
  assert.deepEqual(renamed.complaints, []);
  await renamed.close();
  const cut = await open("cut");
  const told = await cut.until(() => document.querySelector(".message.bad")?.innerText);
  assert(/cells\.csv/.test(told), told);
  assert(await cut.get("draws") > 0);
  const { x, y } = await seen(cut);
  await cut.tab.mouse.click(...(await onScreen(cut, x, y)));
  for (const key of ["m", "h", "c", "i"]) await cut.key(key);
  await cut.button("Share").click();
  await cut.button("Copy as command").click();
  await nap(200);
  assert.deepEqual(cut.complaints, []);
  await cut.close();
  const parquet = await open("parquet");
  assert.equal(await parquet.get("things"), manifestOf(at("parquet")).totals.cells);
  assert.deepEqual(parquet.complaints, []);
  await parquet.close();
}

// Pictures of all sizes have as many pixels as they say, and the same in them.
async function sizes({ open }) {
  const session = await open("blender");
  const { width, height } = await session.size();
  const means = [];
  for (const times of [1, 2, 3, 4]) {
    await session.key("s");
    await session.tab.selectOption("#save select", String(times));
    const [download] = await Promise.all([session.tab.waitForEvent("download"), session.button("Save").click()]);
    const picture = await decode(session.tab, fs.readFileSync(await download.path()));
    assert.deepEqual([picture.width, picture.height], [times * width, times * height]);
    // the mean of each of 8 x 8 parts
    const part = (i, j) => {
      let [sum, n] = [0, 0];
      for (let y = Math.floor((j * picture.height) / 8); y < Math.floor(((j + 1) * picture.height) / 8); y += times) {
        for (let x = Math.floor((i * picture.width) / 8); x < Math.floor(((i + 1) * picture.width) / 8); x += times) {
          sum += picture.data[4 * (y * picture.width + x)];
          n++;
        }
      }
      return sum / n;
    };
    means.push(Array.from({ length: 64 }, (_, n) => part(n % 8, n >> 3)));
  }
  for (const mean of means) mean.forEach((m, n) => assert(Math.abs(m - means[0][n]) < 6, `part ${n} is ${m}, ${means[0][n]} at the size of the screen`));
  await session.close();
}

/** [name, test]. */
export const PANELS = [
  ["cut faces are flat in every colouring, and where something is left out", cutFaces],
  ["what material hides from all sides is shown", buried],
  ["two clicks on a row", rowTwice],
  ["what is ranked is told and shown", ranking],
  ["places of a scan far from the origin", farAway],
  ["a command makes what is shown", commands],
  ["nothing that is needed is covered in any window", layouts],
  ["all is done with the keyboard alone", keyboard],
  ["tables that were changed, cut, or damaged beside others", tables],
  ["pictures of all sizes", sizes],
];
