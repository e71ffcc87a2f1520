// SPDX-License-Identifier: Apache-2.0
// A verdict is always a symbol, a word and a colour. Symbols are those of the terminal and the reports.
import { html } from './html.js';
import { useWords } from './words.js';

export const kVerdicts = ['none', 'pass', 'fail', 'not_measured', 'aborted', 'indeterminate'];
const kSymbols = { none: '·', pass: '✓', fail: '✗', not_measured: '∅', aborted: '⊘', indeterminate: '?' };

/// The verdict if it is known, else none: a foreign word is never a pass.
export function known(verdict) {
  return kVerdicts.includes(verdict) ? verdict : 'none';
}

export const symbol = (verdict) => kSymbols[known(verdict)];

/// The verdict whose colour a band has. A pass before SLAB_END is provisional: only the slab's end makes it final.
export const bandVerdict = (verdict, ended) => (ended || verdict !== 'pass' ? known(verdict) : 'none');

/// Symbol and word in the colour of the verdict.
export function VerdictMark({ verdict, className = '' }) {
  const { t } = useWords();
  const which = known(verdict);
  return html`<span class=${`verdict v-${which} ${className}`}>
    <span class="verdict-symbol" aria-hidden="true">${symbol(which)}</span> <span>${t(`verdict.${which}`)}</span>
  </span>`;
}
