// SPDX-License-Identifier: Apache-2.0
// A field of a form with its label, and the rules for texts that are recorded.
import { html } from '../html.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';

/// Most bytes of a text that is recorded. The server has the same limit.
export const kTextBytes = 400;

export const bytesOf = (text) => new TextEncoder().encode(text).length;

/// `text` with line ends and other control characters as one space each: a recorded text is one line.
export const oneLine = (text) => text.replace(/[\u0000-\u001f\u007f]+/g, ' ');

/// `children`: the control of the field.
export function Field({ label, children }) {
  return html`<label class="field"><span>${label}</span>${children}</label>`;
}

/// A text of one line that may be long. `set` gets the text.
export function LongText({ label, name, value, set }) {
  return html`<${Field} label=${label}><textarea name=${name} rows="2" value=${value} required
    onInput=${(event) => set(oneLine(event.target.value))}></textarea><//>`;
}

/// Why a form cannot be sent. `text`: key of the text, '' if it can; `bytes`: size of a text that is too long.
export function Problem({ text: key, bytes }) {
  const { t } = useWords();
  return key && html`<p class="warning-line" role="alert"><span aria-hidden="true">! </span>${t(key, { bytes, most: kTextBytes })}</p>`;
}

/// The server's answer to what was sent. It is on the page before it has a text, so that the text is announced.
export function Recorded({ text }) {
  const { t } = useWords();
  return html`<p role="status" class=${text === '' ? 'for-readers' : 'done-line'}>
    ${text !== '' && html`<span aria-hidden="true">✓ </span>${t('form.recorded')}: <${Foreign} text=${text} />`}</p>`;
}
