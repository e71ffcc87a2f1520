// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import test from 'node:test';
import { beyond, colourOf, heightColour, scaleFor } from '../src/parts/heat_scale.js';
import { cell, centre, difference, extent, mapOf, section } from '../src/parts/profile.js';
import { blocksOf, rowsOf } from '../src/parts/slab_map.js';

const document = JSON.parse(readFileSync(new URL('fixtures/block_map_4.json', import.meta.url), 'utf8'));
const small = { columns: 3, rows: 2, cell_mm: 4, origin_mm: [-4, -2], values: [1, null, 3, 4, 5, 6] };

test('a stored map has its cells in the block frame', () => {
  const map = mapOf(document, 'deviation');
  assert.equal(map.values.length, map.columns * map.rows);
  assert.deepEqual(centre(map, 0, 0), [-198, -298]);
  assert.deepEqual(centre(map, 99, 149), [198, 298]);
  assert.equal(mapOf({ ...document, seat: null }, 'seat'), null);
  assert.equal(mapOf({ deviation: { columns: 2, rows: 2, values_mm: [1] } }, 'deviation'), null);
});
test('cells outside the map are missing', () => {
  assert.equal(cell(small, 0, 1), 4);
  assert.equal(cell(small, 1, 0), null);
  assert.equal(cell(small, 3, 0), null);
  assert.equal(cell(small, 0, -1), null);
});
test('a section along the rail is a row, one across it a column', () => {
  assert.deepEqual(section(small, 1, 0, 0).map((sample) => [sample.at_mm, sample.value]), [[-4, 1], [0, null], [4, 3]]);
  assert.deepEqual(section(small, 2, 0, 90).map((sample) => [sample.at_mm, sample.value]), [[0, 3], [4, 6]]);
  assert.deepEqual(extent(section(small, 1, 0, 0)), { low: 1, high: 3 });
  assert.deepEqual(extent([]), { low: null, high: null });
});
test('a difference needs equal maps', () => {
  assert.deepEqual(difference(small, { ...small, values: [2, 2, 2, 2, 2, null] }).values, [1, null, -1, -2, -3, null]);
  assert.equal(difference(small, { ...small, columns: 2 }), null);
  assert.equal(difference(small, null), null);
});
test('the scale is even: lightness increases with the height', () => {
  const lightness = ([r, g, b]) => 0.2126 * r ** 2.2 + 0.7152 * g ** 2.2 + 0.0722 * b ** 2.2;
  let before = -1;
  for (let share = 0; share <= 1; share += 0.02) {
    const now = lightness(colourOf(share));
    assert.ok(now > before, `${share}`);
    before = now;
  }
  assert.deepEqual(heightColour(0, 1), colourOf(0.5));
  assert.deepEqual(heightColour(99, 1), colourOf(1));
});
test('the automatic scale contains 98 % of the cells and counts the rest', () => {
  assert.equal(scaleFor([0.01, -0.04, null]), 0.05);
  assert.equal(scaleFor(Array.from({ length: 100 }, (_, i) => (i < 99 ? 0.3 : 9))), 0.5);
  assert.equal(scaleFor([]), 0.05);
  assert.equal(beyond([0.6, -0.6, 0.4, null], 0.5), 2);
});
test('rows of 5 and 9 pairs', () => {
  assert.deepEqual(rowsOf(18), [[1, 2, 3, 4, 5, 6, 7, 8, 9], [18, 17, 16, 15, 14, 13, 12, 11, 10]]);
  assert.deepEqual(rowsOf(10), [[1, 2, 3, 4, 5], [10, 9, 8, 7, 6]]);
});
test('blocks that were not scanned are there', () => {
  const blocks = blocksOf({ stations: 4, station_verdicts: [], blocks: [{ station: 2, final_verdict: 'pass', final_reason: 0 }] });
  assert.deepEqual(blocks.map((block) => [block.station, block.verdict]).sort(), [[1, 'none'], [2, 'pass'], [3, 'none'], [4, 'none']]);
});
