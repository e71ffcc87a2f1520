// SPDX-License-Identifier: Apache-2.0
// The figures of the page against the output of slabctl on the same slab.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import test from 'node:test';
import { deviationFigure, duration, figure, limitsFigure, localTime, nominalFigure, rangesText, uncertaintyFigure, valueFigure }
  from '../src/figures.js';
import { itemsInForce } from '../src/pages/block.js';

const read = (name) => readFileSync(new URL(`fixtures/${name}`, import.meta.url), 'utf8');

/// Rows of the tables of `slabctl show --block`: {label, columns}, for items only.
function tableRows(text) {
  const rows = [];
  for (const line of text.split('\n')) {
    const found = /^(\w+) \[(mm|deg)\](?: (\d+(?:-\d+)?))? +(.*)$/.exec(line);
    if (found === null) continue;
    const columns = found[4].split(/ {2,}/);
    // The budget table has other columns.
    if (columns.length !== 6) continue;
    rows.push({ id: found[1], unit: found[2], place: found[3] ?? '', columns });
  }
  return rows;
}

test('every figure of a block is that of slabctl show', () => {
  const slab = JSON.parse(read('slab_fail.json'));
  const block = slab.blocks.find((one) => one.station === 4);
  const { own, in_slab } = itemsInForce(slab, block);
  const rows = tableRows(read('show_block_4.txt'));
  assert.equal(rows.length, own.length + in_slab.length);
  assert.ok(rows.length > 15);
  const ours = [...own.map((item) => [item, '']), ...in_slab.map((item) => [item, item.stations.join('-')])];
  for (const row of rows) {
    const [item] = ours.find(([one, place]) => one.id === row.id && place === row.place);
    const limits = item.lower === null && item.upper === null ? 'info' : limitsFigure(item);
    assert.deepEqual([nominalFigure(item), limits, valueFigure(item), deviationFigure(item), uncertaintyFigure(item)],
      row.columns.slice(0, 5), `${row.id} ${row.place}`);
    assert.equal(item.unit, row.unit);
  }
});

test('rounding is that of C: the nearest, of two equally near ones the even one', () => {
  for (const [value, decimals, expected] of [[0.125, 2, '0.12'], [0.375, 2, '0.38'], [2.5, 0, '2'], [3.5, 0, '4'], [-0.125, 2, '-0.12'],
    [1.005, 2, '1.00'], [0.0005, 3, '0.001'], [1e-9, 3, '0.000'], [-1e-9, 3, '0.000'], [1234.5678, 3, '1234.568'], [0.00048828125, 10, '0.0004882812']])
    assert.equal(figure(value, decimals), expected, `${value}`);
});
test('a missing value is a dash', () => {
  for (const value of [null, undefined, NaN, Infinity, '1']) assert.equal(figure(value, 3), '-');
});
test('a failed value has enough digits to differ from its limit', () => {
  const item = { unit: 'mm', value: 0.50004, lower: -0.5, upper: 0.5, U: 0.0001, verdict: 'fail', deviation: 0.50004 };
  assert.equal(valueFigure(item), '0.50004');
  assert.equal(limitsFigure(item), '-0.50000 .. 0.50000');
  assert.equal(valueFigure({ ...item, verdict: 'indeterminate' }), '0.500');
});
test('limits with one side', () => {
  assert.equal(limitsFigure({ unit: 'mm', value: null, lower: null, upper: 1, verdict: 'none' }), '<= 1.000');
  assert.equal(limitsFigure({ unit: 'deg', value: null, lower: 0.1, upper: null, verdict: 'none' }), '>= 0.1000');
  assert.equal(limitsFigure({ unit: 'mm', value: null, lower: null, upper: null, verdict: 'none' }), '');
});
test('an uncertainty is never zero', () => {
  assert.equal(uncertaintyFigure({ unit: 'mm', U: 0.0004 }), '< 0.001');
  assert.equal(uncertaintyFigure({ unit: 'deg', U: 0.00004 }), '< 0.0001');
  assert.equal(uncertaintyFigure({ unit: 'mm', U: null }), '-');
});
test('ranges of numbers', () => {
  assert.equal(rangesText([1, 2, 3, 5, 8, 9]), '1-3, 5, 8-9');
  assert.equal(rangesText([]), '');
});
test('times have the zone; a missing time is empty', () => {
  assert.match(localTime('2026-11-20T23:28:01Z'), /^2026-11-2\d \d\d:\d8:01 [+-]\d\d:\d\d$/);
  assert.equal(localTime(1_795_937_624_000_000).length, 26);
  for (const none of [0, null, '', 'nonsense']) assert.equal(localTime(none), '');
});
test('durations have their two largest units', () => {
  assert.deepEqual([0, 59.9, 60, 3_700, 90_000].map((s) => duration(s)), ['0 s', '59 s', '1 min 0 s', '1 h 1 min', '1 d 1 h']);
});
