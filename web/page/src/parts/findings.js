// SPDX-License-Identifier: Apache-2.0
// Findings of a slab: what did not pass, with value, limits, U and place. The server makes the sentences (slab_map/1,
// from report/findings.h), or they are made here from the items of slab/1.
import { html } from '../html.js';
import { Link } from '../router.js';
import { Foreign } from '../text.js';
import { known, symbol } from '../verdict.js';
import { useWords } from '../words.js';
import { itemSentence } from './items.js';

const kOrder = ['fail', 'not_measured', 'aborted', 'indeterminate'];

/// Findings of a slab/1 document: {verdict, stations, text}.
export function findingsOfSlab(slab, words) {
  const all = [];
  const take = (item, stations) => {
    if (!kOrder.includes(item.verdict)) return;
    if (item.verdict === 'not_measured' && !item.required) return;
    all.push({ verdict: item.verdict, stations, text: itemSentence(words, item), id: item.id });
  };
  const replaced = (id, station) =>
    slab.items.some((item) => item.id === id && item.stations?.length === 1 && item.stations[0] === station &&
      (item.lower !== null || item.upper !== null));
  for (const block of slab.blocks) {
    if (!block.valid || !block.result) continue;
    for (const item of block.result.items) if (!replaced(item.id, block.station)) take(item, [block.station]);
  }
  for (const item of slab.items) take(item, item.stations ?? []);
  for (const station of slab.station_verdicts ?? []) {
    if (!kOrder.includes(station.verdict) || all.some((finding) => finding.stations.includes(station.station))) continue;
    all.push({ verdict: station.verdict, stations: [station.station], text: words.reason(station.reason), id: '' });
  }
  const rank = (finding) => kOrder.indexOf(finding.verdict);
  return all.sort((a, b) => rank(a) - rank(b) || (a.stations[0] ?? 0) - (b.stations[0] ?? 0));
}

/// Findings of a slab_map/1 document: an entry is a sentence, or {verdict, station | stations, text}.
export function findingsOfMap(map) {
  return (map?.findings ?? []).map((entry) =>
    typeof entry === 'string'
      ? { verdict: map.verdict, stations: [], text: entry }
      : { ...entry, verdict: known(entry.verdict), stations: entry.stations ?? (entry.station ? [entry.station] : []) },
  );
}

export function FindingList({ findings, slabKey, max = Infinity, empty }) {
  const { t } = useWords();
  if (findings.length === 0) return html`<p class="quiet">${empty}</p>`;
  const shown = findings.slice(0, max);
  const rest = findings.length - shown.length;
  return html`<ul class="findings">
    ${shown.map((finding, i) => {
      const verdict = known(finding.verdict);
      const blocks = finding.stations.map((station, n) => html`${n > 0 ? ', ' : ''}${slabKey
        ? html`<${Link} to=${`/slabs/${slabKey}/blocks/${station}`}>${t('page.block', { station })}<//>`
        : t('page.block', { station })}`);
      return html`<li key=${i} class=${`finding v-${verdict}`}>
        <span class="finding-mark"><span aria-hidden="true">${symbol(verdict)}</span>
          <span class="for-readers">${t(`verdict.${verdict}`)}</span></span>
        <span class="finding-text">${blocks}${blocks.length > 0 && finding.text && !finding.whole ? ' · ' : ''}
          <${Foreign} text=${finding.text} max=${600} /></span>
      </li>`;
    })}
    ${rest > 0 && html`<li class="quiet">${t('live.more_findings', { count: rest })}</li>`}
  </ul>`;
}
