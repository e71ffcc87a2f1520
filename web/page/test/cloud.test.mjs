// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import test from 'node:test';
import { cloudOf, exaggerated, heightRange, int16_of, sharesOf } from '../src/parts/cloud.js';

const recorded = JSON.parse(readFileSync(new URL('fixtures/block_cloud.json', import.meta.url), 'utf8'));
const base64 = (numbers) => Buffer.from(Int16Array.from(numbers).buffer).toString('base64');
const small = {
  points: 2, points_read: 9, step_mm: 0.5, origin_mm: [10, 20, 30], xyz: base64([0, 1, -1, 2, -32767, 32767]),
  deviation_step_mm: 0.001, deviation: base64([-250, -32768]), seat: { normal: [0, 0, 1], offset_mm: 1 },
};
const close = (a, b) => assert.ok(Math.abs(a - b) < 1e-3, `${a} ${b}`);

test('base64 becomes little-endian numbers with a sign', () => {
  assert.deepEqual([...int16_of('AQD//wCA/38=')], [1, -1, -32768, 32767]);
  assert.deepEqual([...int16_of('')], []);
  assert.equal(int16_of('AQ=='), null);
  assert.equal(int16_of('!'), null);
});
test('points are in the block frame, a missing deviation is not a number', () => {
  const cloud = cloudOf(small);
  assert.equal(cloud.count, 2);
  assert.equal(cloud.read, 9);
  assert.deepEqual([...cloud.positions], [10, 20.5, 29.5, 11, 20 - 16383.5, 30 + 16383.5]);
  close(cloud.values[0], -0.25);
  assert.ok(Number.isNaN(cloud.values[1]));
  assert.equal(cloud.measured, true);
});
test('without a recipe the values are heights above the seat plane, and are not exaggerated', () => {
  const cloud = cloudOf({ ...small, deviation: null });
  assert.equal(cloud.measured, false);
  close(cloud.values[0], 28.5);
  assert.equal(exaggerated(cloud, 100), cloud.positions);
  close(cloudOf({ ...small, deviation: null, seat: null }).values[0], 29.5);
});
test('a document whose numbers do not fit each other is not usable', () => {
  assert.equal(cloudOf(null), null);
  assert.equal(cloudOf({ ...small, points: 3 }), null);
  assert.equal(cloudOf({ ...small, points: 0, xyz: '' }), null);
  assert.equal(cloudOf({ ...small, deviation: base64([1]) }), null);
});
test('deviations are exaggerated along the normal, points without one stay', () => {
  const cloud = cloudOf({ ...small, seat: { normal: [0, 0.6, 0.8], offset_mm: 0 } });
  const out = exaggerated(cloud, 11);
  close(out[0], 10);
  close(out[1], 20.5 - 2.5 * 0.6);
  close(out[2], 29.5 - 2.5 * 0.8);
  assert.deepEqual([...out.slice(3)], [...cloud.positions.slice(3)]);
  assert.equal(exaggerated(cloud, 1), cloud.positions);
});
test('a value has its place on the scale', () => {
  const shares = sharesOf(Float32Array.of(-9, -1, 0, 0.5, 9, NaN), -1, 1);
  assert.deepEqual([...shares], [0, 0, 0.5, 0.75, 1, NaN]);
  assert.deepEqual(heightRange(Float32Array.from({ length: 1001 }, (_, i) => i / 10)), [1, 99]);
  assert.deepEqual(heightRange(Float32Array.of(5, 5)), [5, 6]);
  assert.deepEqual(heightRange(new Float32Array(0)), [0, 1]);
});
test('a recorded scan lies on its block', () => {
  const cloud = cloudOf(recorded);
  assert.equal(cloud.count, recorded.points);
  assert.ok(cloud.size_mm > 400 && cloud.size_mm < 600, `${cloud.size_mm}`);
  const near = [...cloud.values].filter((value) => Math.abs(value) < 1);
  assert.ok(near.length > 0.9 * cloud.count);
});
