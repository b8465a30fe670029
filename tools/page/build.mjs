// node build.mjs OUTPUT: three.js as one classic script that runs nothing until it is called.
// The bytes depend on package-lock.json alone.
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const three = JSON.parse(readFileSync(join(here, "node_modules/three/package.json"), "utf8"));
const made = await build({
  absWorkingDir: here, entryPoints: ["three_entry.js"], bundle: true, minify: true, write: false,
  format: "cjs", target: "es2022", charset: "ascii", legalComments: "none", tsconfigRaw: {},
});
const head = `/* three.js ${three.version}, MIT licence, Copyright 2010-2026 three.js authors: three.LICENSE.txt */\n` +
  `"use strict";\nwindow.legoworldThree = function () {\nconst module = { exports: {} };\n`;
const body = made.outputFiles[0].text.trim().replaceAll("</script", "<\\/script").replaceAll("<!--", "<\\!--");
writeFileSync(process.argv[2], head + body + "\nreturn module.exports;\n};\n");
