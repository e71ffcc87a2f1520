// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { visible } from '../src/text.js';

test('markup stays text', () => {
  assert.equal(visible('<img src=x onerror=alert(1)>'), '<img src=x onerror=alert(1)>');
});
test('control characters become pictures', () => {
  assert.equal(visible('a\u0000b\u001b[31m\n\t\u007f'), 'a␀b␛[31m␊␉␡');
});
test('characters that are invisible or change the direction are named', () => {
  assert.equal(visible('a\u202eb'), 'a⟨U+202E⟩b');
  assert.equal(visible('\u2066\u200b\ufeff\u00ad\u061c'), '⟨U+2066⟩⟨U+200B⟩⟨U+FEFF⟩⟨U+00AD⟩⟨U+061C⟩');
  assert.equal(visible('\u{e0041}'), '⟨U+E0041⟩');
  assert.equal(visible('\u0085'), '⟨U+0085⟩');
  assert.equal(visible('\ud800x'), '⟨U+D800⟩x');
});
test('wide characters and letters of other scripts stay', () => {
  const wide = '轨'.repeat(32);
  assert.equal(visible(wide), wide);
  assert.equal(visible('Prüfling Ω 😀'), 'Prüfling Ω 😀');
});
test('a long text is cut at a whole character', () => {
  assert.equal(visible('😀'.repeat(5), 3), '😀😀😀…');
});
test('nothing is empty', () => {
  assert.equal(visible(null), '');
  assert.equal(visible(undefined), '');
  assert.equal(visible(0), '0');
});
