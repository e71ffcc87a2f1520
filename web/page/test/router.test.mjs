// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { filtersOf } from '../src/pages/slabs.js';
import { address, ownAddress, routeOf } from '../src/router.js';
import { languageOf, themeOf } from '../src/settings.js';

const at = (path) => {
  const { query, ...route } = routeOf(path);
  return route;
};

test('addresses name their pages', () => {
  assert.deepEqual(at('/'), { page: 'live' });
  assert.deepEqual(at('/slabs'), { page: 'slabs' });
  assert.deepEqual(at('/slabs/'), { page: 'slabs' });
  assert.deepEqual(at('/slabs/55'), { page: 'slab', key: '55' });
  assert.deepEqual(at('/slabs/55/blocks/18'), { page: 'block', key: '55', station: 18 });
  assert.deepEqual(at('/trends/seat_slope'), { page: 'trends', item: 'seat_slope' });
  for (const page of ['trends', 'moulds', 'plant', 'drafts', 'calibration', 'line', 'compare', 'about', 'login']) assert.deepEqual(at(`/${page}`), { page });
});
test('other addresses are unknown', () => {
  for (const path of ['/slabs/0', '/slabs/x', '/slabs/1/blocks/19', '/slabs/1/blocks/0', '/slabs/../etc', '/moulds/7', '/trends/A', '/slabs/12345678901234567890'])
    assert.equal(at(path).page, 'unknown', path);
});
test('an address has only parameters with a value', () => {
  assert.equal(address('/slabs', { id: 'a b&c', since: '', block: undefined, limit: 50 }), '/slabs?id=a+b%26c&limit=50');
  assert.equal(address('/slabs', {}), '/slabs');
});
test('a login returns only to a page of this server', () => {
  for (const to of ['/', '/slabs', '/slabs/55', '/slabs?verdict=fail&id=A+1', '/moulds?mould=3', '/trends/seat_slope?block=4'])
    assert.equal(ownAddress(to), to);
  assert.equal(ownAddress('/slabs/55#top'), '/slabs/55');
  for (const to of ['', null, undefined, 'slabs', '//evil.example', '/\\evil.example', '/\t/evil.example', '/\n/evil.example/slabs', '/..//evil.example',
    'https://evil.example/slabs', 'javascript:alert(1)', '/nothing', '/api/v1/logout', '/login', '/login?to=/login', '///', '/\0'])
    assert.equal(ownAddress(to), '/', String(to));
});
test('filters of another form are ignored', () => {
  const query = new URLSearchParams('id=%1b[31m&since=7d&verdict=PASS&block=19&item=seat_slope&limit=99999&slab_type=5600');
  assert.deepEqual(filtersOf(query), { since: '7d', item: 'seat_slope', slab_type: '5600' });
});
test('the language: address, then the stored one, then the browser', () => {
  assert.equal(languageOf('zh', 'en', ['en']), 'zh');
  assert.equal(languageOf(null, 'zh', ['en']), 'zh');
  assert.equal(languageOf('fr', null, ['fr-FR', 'zh-CN']), 'zh');
  assert.equal(languageOf(null, null, undefined), 'en');
});
test('the colours follow the system unless they are chosen', () => {
  assert.equal(themeOf('auto', true, false), 'dark');
  assert.equal(themeOf('auto', true, true), 'contrast');
  assert.equal(themeOf('light', true, true), 'light');
  assert.equal(themeOf('nonsense', false, false), 'light');
});
