// SPDX-License-Identifier: Apache-2.0
// Where a value is between its limits: the limits are the ends of the bar, the interval is value +- U. The bar is drawn
// for sight; the numbers are in the same row of the table.
import { html } from '../html.js';
import { known } from '../verdict.js';

const kWidth = 132;
const kHeight = 20;
const kEdge = 22;

/// Position of `value` on the bar, px. A one-sided item has its nominal value at the other end.
function place(item) {
  const low = item.lower ?? item.nominal;
  const high = item.upper ?? item.nominal;
  if (low === null || high === null || !(high > low)) return null;
  return (value) => kEdge + ((value - low) / (high - low)) * (kWidth - 2 * kEdge);
}

const inside = (x) => Math.min(kWidth - 3, Math.max(3, x));

export function Place({ item }) {
  const at = place(item);
  if (at === null || item.value === null) return null;
  const middle = kHeight / 2;
  const x = at(item.value);
  const beyond = x < 3 || x > kWidth - 3;
  return html`<svg class=${`place v-${known(item.verdict)}`} width=${kWidth} height=${kHeight} aria-hidden="true">
    <line class="place-range" x1=${kEdge} x2=${kWidth - kEdge} y1=${middle} y2=${middle} />
    ${item.lower !== null && html`<line class="place-limit" x1=${kEdge} x2=${kEdge} y1="3" y2=${kHeight - 3} />`}
    ${item.upper !== null &&
    html`<line class="place-limit" x1=${kWidth - kEdge} x2=${kWidth - kEdge} y1="3" y2=${kHeight - 3} />`}
    ${item.U > 0 &&
    html`<line class="place-u" x1=${inside(at(item.value - item.U))} x2=${inside(at(item.value + item.U))} y1=${middle} y2=${middle} />`}
    ${beyond
      ? html`<path class="place-value" d=${x < 3 ? `M2 ${middle}l8 -6v12z` : `M${kWidth - 2} ${middle}l-8 -6v12z`} />`
      : html`<circle class="place-value" cx=${x} cy=${middle} r="4.5" />`}
  </svg>`;
}
