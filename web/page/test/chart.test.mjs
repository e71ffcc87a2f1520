// SPDX-License-Identifier: Apache-2.0
// Columns and range of the control chart, for blocks with the same and with different limits.
import assert from 'node:assert/strict';
import test from 'node:test';
import { columnsOf, rangeOf } from '../src/parts/chart_data.js';

const point = (value, lowest, highest, outside) => ({ value, lowest, highest, outside, signal: 'none' });
const trend = (more) => ({ lower: -1, upper: 1, chart: { lower_control: -0.5, upper_control: 0.5 },
  series: [point(0, -0.2, 0.3, 0), point(0.1, -0.1, 1.5, 1)], ...more });

test('a cross is at the value outside the limits', () => {
  assert.deepEqual(columnsOf(trend()).at(-1), [null, 1.5]);
});
test('blocks with different limits: no limit is drawn, and a cross is at the value of the slab', () => {
  const differ = trend({ limits_differ: true, upper: 9 });
  assert.deepEqual(columnsOf(differ).at(-1), [null, 0.1]);
  assert.ok(rangeOf(differ)[1] < 2, 'the limit of one block does not stretch the axis');
  assert.ok(rangeOf(trend({ upper: 9 }))[1] > 9);
});
