// Khronos' glTF validator over every tile below the directories given: node validate.js DIR...
// Prints each finding and ends with `N passed, N failed`, counted in tile sets.
"use strict";
const fs = require("fs");
const path = require("path");
const validator = require("gltf-validator");

function tiles(dir) {
  return fs
    .readdirSync(dir, { recursive: true })
    .filter((name) => name.endsWith(".glb"))
    .map((name) => path.join(dir, name))
    .sort();
}

async function validate(file) {
  const bytes = new Uint8Array(fs.readFileSync(file));
  const report = await validator.validateBytes(bytes, { uri: file, maxIssues: 20 });
  const { numErrors, numWarnings, messages } = report.issues;
  for (const m of messages.filter((m) => m.severity < 2)) {
    console.log(`${file}: ${m.code} ${m.pointer}: ${m.message}`);
  }
  return [numErrors, numWarnings];
}

async function main() {
  let passed = 0;
  let failed = 0;
  for (const dir of process.argv.slice(2)) {
    const sum = [0, 0];
    const files = tiles(dir);
    for (const file of files) {
      const found = await validate(file);
      sum[0] += found[0];
      sum[1] += found[1];
    }
    const ok = files.length > 0 && sum[0] === 0 && sum[1] === 0;
    console.log(`${ok ? "ok" : "FAILED"} ${dir}: ${files.length} tiles, ${sum[0]} errors, ${sum[1]} warnings`);
    ok ? passed++ : failed++;
  }
  console.log(`${passed} passed, ${failed} failed`);
  process.exitCode = failed === 0 && passed > 0 ? 0 : 1;
}

main();
