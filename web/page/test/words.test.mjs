// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import test from 'node:test';
import { en } from '../src/words/en.js';
import { zh } from '../src/words/zh.js';
import { say, wordsOf } from '../src/words.js';

const sources = readdirSync(new URL('../src', import.meta.url), { recursive: true })
  .filter((name) => name.endsWith('.js') && !name.startsWith('words/'))
  .map((name) => readFileSync(new URL(`../src/${name}`, import.meta.url), 'utf8')).join('\n');

test('both catalogues have the same keys, in the same order', () => {
  assert.deepEqual(Object.keys(zh), Object.keys(en));
});
test('both texts of a key have the same placeholders', () => {
  const names = (text) => [...text.matchAll(/\{(\w+)\}/g)].map((found) => found[1]).sort();
  for (const key of Object.keys(en)) assert.deepEqual(names(zh[key]), names(en[key]), key);
});
test('Chinese texts are Chinese', () => {
  const same = ['app.title', 'link.plc', 'emulation.line', 'map.row_left', 'map.row_right', 'field.u', 'heat.value', 'heat.plus_minus', 'about.slabd',
    'about.web', 'compare.map_difference'];
  for (const [key, text] of Object.entries(zh)) if (!same.includes(key)) assert.match(text, /\p{Script=Han}/u, key);
});
test('every key that the page uses is in the catalogues', () => {
  const used = [...sources.matchAll(/\bt\('([a-z_.0-9]+)'/g)].map((found) => found[1]);
  assert.ok(used.length > 150);
  for (const key of used) assert.ok(key in en, key);
});
test('every bit of WARN has a text, and the live page shows it', () => {
  const headers = ['plc.h', 'calibration.h'].map((name) => readFileSync(new URL(`../../../base/${name}`, import.meta.url), 'utf8'));
  const bits = [...headers.join('\n').matchAll(/kWarn\w+ = 1U << (\d+)U/g)];
  assert.equal(bits.length, 16);
  for (const [, bit] of bits) assert.ok(`warn.${bit}` in zh, bit);
  assert.ok(sources.includes('length: 16 }, (_, bit) => bit'));
});
test('every key of the catalogues is used, by itself or by its group', () => {
  const groups = [...sources.matchAll(/['`]([a-z_]+\.)(?:\$\{|')/g)].map((found) => found[1]);
  for (const key of Object.keys(en))
    assert.ok(sources.includes(`'${key}'`) || groups.some((group) => key.startsWith(group)) || /^link\.\w+\.\w+$/.test(key), key);
});
test('values are put into a text, unknown names stay', () => {
  assert.equal(say('en', 'live.scanned', { done: 3, all: 18 }), '3 of 18 scanned');
  assert.equal(say('zh', 'live.scanned', { done: 3, all: 18 }), '已扫描 3 / 18');
  assert.equal(say('en', 'live.scanned', { done: 3 }), '3 of {all} scanned');
});
test('names of items and sentences of reasons come from the server', () => {
  const words = wordsOf('en', { items: { seat_slope: 'seat slope' }, reasons: { 600: 'the seat slope is out of tolerance' } });
  assert.equal(words.item('seat_slope'), 'seat slope');
  assert.equal(words.item('new_item'), 'new item');
  assert.equal(words.reason(600), 'the seat slope is out of tolerance');
  assert.equal(words.reason(0), '');
  assert.equal(words.reason(999), 'code 999');
  assert.equal(words.reason(999, 'a text of the document'), 'a text of the document');
});
