// SPDX-License-Identifier: Apache-2.0
// Bundles the page into a folder: index.html, app.js, app.css, three.js, icon.svg, licences.txt. The same sources and
// versions give the same bytes.
//
//     node bundle.mjs FOLDER
import { copyFile, mkdir, readFile, rm, writeFile } from 'node:fs/promises';
import { join } from 'node:path';
import { build } from 'esbuild';

const kLibraries = ['preact', 'htm', 'uplot', 'three'];
const folder = process.argv[2];
if (!folder) {
  console.error('usage: node bundle.mjs FOLDER');
  process.exit(2);
}
const here = import.meta.dirname;
const own = JSON.parse(await readFile(join(here, 'package.json'), 'utf8'));
const versions = Object.fromEntries([['page', own.version], ...kLibraries.map((name) => [name, own.dependencies[name]])]);

await rm(folder, { recursive: true, force: true });
await mkdir(folder, { recursive: true });
const shared = {
  absWorkingDir: here,
  bundle: true,
  minify: true,
  format: 'esm',
  target: ['chrome111', 'firefox115', 'safari16.4'],
  charset: 'utf8',
  legalComments: 'none',
  logLevel: 'warning',
  define: { __VERSIONS__: JSON.stringify(versions) },
};
await build({ ...shared, entryPoints: ['src/main.js'], outfile: join(folder, 'app.js'), external: ['/assets/*'] });
await build({ ...shared, entryPoints: ['src/surface/surface.js'], outfile: join(folder, 'three.js') });
await build({ ...shared, entryPoints: ['src/styles/app.css'], outfile: join(folder, 'app.css') });
for (const name of ['index.html', 'icon.svg']) await copyFile(join(here, name), join(folder, name));

let licences = 'Libraries in this page, with their licences.\n';
for (const name of kLibraries) {
  const text = await readFile(join(here, 'node_modules', name, 'LICENSE'), 'utf8');
  licences += `\n${'='.repeat(78)}\n${name} ${own.dependencies[name]}\n\n${text.replaceAll('\r\n', '\n').trim()}\n`;
}
await writeFile(join(folder, 'licences.txt'), licences);
