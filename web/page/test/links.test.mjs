// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { armsOf, linksOf, nameOfLink } from '../src/parts/links.js';

const pose = (ok) => ({ ok, code: ok ? 0 : 201, text: ok ? 'no fault' : 'no pose arrives', note: '' });
const one = {
  links: { plc: { alive: true, clients: 1 }, pose: pose(true), scanner: { online: true, text: '' }, store: { ok: true, text: '' } },
  calibration: { source: 'applied', id: 'he-1' }, scanner_temperature_c: 31.5, tie: null,
};
const arm = (id, ok, source) => ({ robot: id, scanner: id, pose: pose(ok), scanner_link: { online: ok, text: ok ? '' : 'no gateway' },
  calibration: { source, id: `he-${id}` }, acceptance: null, temperature_c: null });
const two = { ...one, arms: [arm('1', true, 'applied'), arm('2', false, 'missing')] };
const keys = (status) => linksOf(status).map((link) => `${link.name} ${link.part}`.trim());

test('a line with one robot has the links that it always had, whether its status lists the robot or not', () => {
  const names = ['plc', 'robot', 'scanner', 'store', 'calibration'];
  assert.deepEqual(keys(one), names);
  assert.deepEqual(keys({ ...one, arms: [arm('1', true, 'applied')] }), names);
  assert.deepEqual(armsOf(one), [{ robot: '', scanner: '', pose: one.links.pose, link: one.links.scanner, calibration: one.calibration,
    temperature_c: 31.5 }]);
  assert.ok(linksOf(one).every((link) => link.ok));
});

test('each robot and each scanner of a line with two has its link, and the tie has one', () => {
  assert.deepEqual(keys(two), ['plc', 'robot 1', 'robot 2', 'scanner 1', 'scanner 2', 'store', 'calibration 1', 'calibration 2', 'tie']);
  const link = (key) => linksOf(two)[keys(two).indexOf(key)];
  assert.equal(link('robot 1').ok, true);
  assert.equal(link('robot 2').ok, false);
  assert.equal(link('robot 2').detail, 'no pose arrives');
  assert.equal(link('scanner 2').cure, 'cure.scanner');
  assert.equal(link('scanner 2').detail, 'no gateway');
  assert.equal(link('calibration 1').word, 'link.calibration.applied');
  assert.equal(link('calibration 2').word, 'link.calibration.missing');
  assert.equal(nameOfLink((key) => key, link('robot 2')), 'link.robot 2');
  assert.equal(nameOfLink((key) => key, link('plc')), 'link.plc');
});

test('a tie that is missing or cannot be used is a link that is down', () => {
  const tie = (value) => linksOf({ ...two, tie: value }).at(-1);
  assert.equal(tie(null).ok, false);
  assert.equal(tie(null).cure, 'cure.tie');
  assert.equal(tie({ id: 'ti-1', robot: '2', expires_utime_us: 0, trouble: '' }).ok, true);
  const stale = tie({ id: 'ti-1', robot: '2', expires_utime_us: 0, trouble: 'solved with another hand-eye calibration' });
  assert.equal(stale.ok, false);
  assert.equal(stale.detail, 'solved with another hand-eye calibration');
});

test('no status at all is a line with one robot, and every link is down', () => {
  assert.deepEqual(keys(undefined), ['plc', 'robot', 'scanner', 'store', 'calibration']);
  assert.ok(linksOf(undefined).every((link) => !link.ok));
});
