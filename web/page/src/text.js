// SPDX-License-Identifier: Apache-2.0
// Text from the PLC, a file or a database. Such text may contain anything: it is shown as text, and characters that are
// invisible or change the direction of the text around them are replaced by visible ones.
import { html } from './html.js';

/// Format characters without a picture of their own: soft hyphen, Arabic letter mark, zero-width and direction marks,
/// line separators, embeddings and isolates, byte order mark, interlinear marks, and the tag characters.
const kInvisible =
  /[\u0080-\u009f\u00ad\u061c\u115f\u1160\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\u3164\ufeff\uffa0\ufff9-\ufffb]|[\u{e0000}-\u{e007f}]/u;

/// Code point as people write it: U+202E in angle brackets.
function named(code) {
  return `⟨U+${code.toString(16).toUpperCase().padStart(4, '0')}⟩`;
}

/// `text` with every control and invisible character replaced by a visible one. Control characters become the pictures
/// U+2400..U+2421. Long texts are cut at `max` characters.
export function visible(text, max = 400) {
  let out = '';
  let count = 0;
  for (const character of String(text ?? '')) {
    const code = character.codePointAt(0);
    if (++count > max) return `${out}…`;
    if (code < 0x20) out += String.fromCodePoint(0x2400 + code);
    else if (code === 0x7f) out += '\u2421';
    else if ((code >= 0xd800 && code <= 0xdfff) || kInvisible.test(character)) out += named(code);
    else out += character;
  }
  return out;
}

/// Foreign text in the page: visible, and isolated from the direction of its surroundings.
export function Foreign({ text, max, className = 'foreign' }) {
  return html`<bdi class=${className}>${visible(text, max)}</bdi>`;
}
