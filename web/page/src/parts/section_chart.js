// SPDX-License-Identifier: Apache-2.0
// The profile along a section. Heights are exaggerated by a stated factor: with 1 both axes have the same scale.
import { figure } from '../figures.js';
import { html } from '../html.js';
import { useWords } from '../words.js';
import { extent } from './profile.js';

const kWidth = 760;
const kHeight = 240;
const kLeft = 64;
const kBottom = 36;
const kTop = 12;

/// Round steps of an axis: about `count` in `span`.
export function step(span, count) {
  const rough = span / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= rough);
}

export function SectionChart({ samples, exaggeration }) {
  const { t } = useWords();
  const { low, high } = extent(samples);
  if (low === null || samples.length < 2) return html`<p class="quiet">${t('heat.hint')}</p>`;
  const from = samples[0].at_mm;
  const to = samples.at(-1).at_mm;
  const scale = (kWidth - kLeft - 12) / (to - from);
  const middle = (low + high) / 2;
  const half = (kHeight - kTop - kBottom) / 2;
  const x = (at) => kLeft + (at - from) * scale;
  const y = (value) => Math.min(kHeight - kBottom, Math.max(kTop, kTop + half - (value - middle) * scale * exaggeration));
  // A missing value interrupts the line.
  let path = '';
  samples.forEach((sample, i) => {
    if (sample.value === null) return;
    path += `${i > 0 && samples[i - 1].value !== null ? 'L' : 'M'}${x(sample.at_mm).toFixed(1)} ${y(sample.value).toFixed(1)}`;
  });
  const range = (2 * half) / (scale * exaggeration);
  const dy = step(range, 4);
  const dx = step(to - from, 8);
  const ticks = (first, last, by) => {
    const out = [];
    for (let i = Math.ceil(first / by); i * by <= last; ++i) out.push(i * by);
    return out;
  };
  const digits = Math.max(0, -Math.floor(Math.log10(dy)));
  const label = t('profile.label', { factor: exaggeration, low: figure(low, 3), high: figure(high, 3) });
  return html`<figure class="section-chart">
    <svg viewBox=${`0 0 ${kWidth} ${kHeight}`} role="img" aria-label=${label}>
      ${ticks(middle - range / 2, middle + range / 2, dy).map((value) => html`<g key=${value}>
        <line class=${`grid${Math.abs(value) < dy / 2 ? ' grid-zero' : ''}`} x1=${kLeft} x2=${kWidth - 12} y1=${y(value)} y2=${y(value)} />
        <text class="tick" x=${kLeft - 8} y=${y(value) + 4} text-anchor="end">${figure(value, digits)}</text></g>`)}
      ${ticks(from, to, dx).map((at) => html`<g key=${at}>
        <line class="grid" x1=${x(at)} x2=${x(at)} y1=${kTop} y2=${kHeight - kBottom} />
        <text class="tick" x=${x(at)} y=${kHeight - kBottom + 18} text-anchor="middle">${figure(at, 0)}</text></g>`)}
      <line class="cursor-line" x1=${x(0)} x2=${x(0)} y1=${kTop} y2=${kHeight - kBottom} />
      <path class="profile-line" d=${path} />
      <text class="tick axis-name" x=${kWidth - 12} y=${kHeight - 4} text-anchor="end">${t('profile.along')}</text>
      <text class="tick axis-name" x="4" y=${kTop}>mm</text>
    </svg>
    <figcaption class="quiet">${label}</figcaption>
  </figure>`;
}
