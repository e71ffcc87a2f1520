// SPDX-License-Identifier: Apache-2.0
// Yield by day and the Pareto of reasons as drawings. The tables next to them have the same numbers.
import { figure } from '../figures.js';
import { html } from '../html.js';
import { useWords } from '../words.js';

const kWidth = 640;
const kHeight = 240;
const kLeft = 44;
const kBottom = 30;
const kTop = 12;
const inner = kHeight - kTop - kBottom;

function PercentGrid() {
  return [0, 25, 50, 75, 100].map((percent) => {
    const y = kTop + inner * (1 - percent / 100);
    return html`<g key=${percent}><line class="grid" x1=${kLeft} x2=${kWidth} y1=${y} y2=${y} />
      <text class="tick" x=${kLeft - 8} y=${y + 4} text-anchor="end">${percent}</text></g>`;
  });
}

/// Yield of every day with its interval; at most the newest 31 days.
export function YieldChart({ groups }) {
  const { t } = useWords();
  const days = groups.slice(-31);
  const width = (kWidth - kLeft) / Math.max(1, days.length);
  const bar = Math.min(48, width * 0.6);
  const every = Math.ceil(days.length / 8);
  const y = (percent) => kTop + inner * (1 - percent / 100);
  return html`<svg class="bars" viewBox=${`0 0 ${kWidth} ${kHeight}`} role="img" aria-label=${t('yield.label', { count: days.length })}>
    <${PercentGrid} />
    ${days.map((day, i) => {
      const x = kLeft + width * (i + 0.5);
      return html`<g key=${day.group}>
        ${day.yield_percent !== null && html`<rect class="bar" x=${x - bar / 2} width=${bar} y=${y(day.yield_percent)} height=${inner - y(day.yield_percent) + kTop} />
          <line class="whisker" x1=${x} x2=${x} y1=${y(day.yield_low_percent)} y2=${y(day.yield_high_percent)} />`}
        ${i % every === 0 && html`<text class="tick" x=${x} y=${kHeight - 8} text-anchor="middle">${day.group.slice(5)}</text>`}
      </g>`;
    })}
  </svg>`;
}

/// Counts of the most frequent reasons, and the line of their cumulative share.
export function ParetoChart({ reasons }) {
  const { t } = useWords();
  const shown = reasons.slice(0, 10);
  const most = shown[0]?.count ?? 1;
  const width = (kWidth - kLeft) / Math.max(1, shown.length);
  const bar = Math.min(72, width * 0.7);
  const y = (share) => kTop + inner * (1 - share);
  const line = shown.map((row, i) => `${i === 0 ? 'M' : 'L'}${kLeft + width * (i + 0.5)} ${y(row.cumulative_percent / 100)}`).join('');
  return html`<svg class="bars" viewBox=${`0 0 ${kWidth} ${kHeight}`} role="img" aria-label=${t('reasons.label', { count: shown.length })}>
    <${PercentGrid} />
    ${shown.map((row, i) => {
      const x = kLeft + width * (i + 0.5);
      return html`<g key=${i}><rect class="bar" x=${x - bar / 2} width=${bar} y=${y((0.92 * row.count) / most)} height=${(inner * 0.92 * row.count) / most} />
        <text class="bar-number" x=${x} y=${kTop + inner - 8} text-anchor="middle">${row.count}</text>
        <text class="tick" x=${x} y=${kHeight - 8} text-anchor="middle">${i + 1}</text></g>`;
    })}
    <path class="pareto-line" d=${line} />
    ${shown.map((row, i) => html`<circle key=${i} class="pareto-dot" cx=${kLeft + width * (i + 0.5)} cy=${y(row.cumulative_percent / 100)} r="4">
      <title>${figure(row.cumulative_percent, 1)} %</title></circle>`)}
  </svg>`;
}
