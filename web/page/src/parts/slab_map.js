// SPDX-License-Identifier: Apache-2.0
// The slab from above: row Y > 0 with blocks 1..n from the left, row Y < 0 below it with 2n..n+1, as on the terminal.
import { html } from '../html.js';
import { Link } from '../router.js';
import { known, symbol, VerdictMark } from '../verdict.js';
import { useWords } from '../words.js';

/// Stations of both rows in the order of the picture.
export function rowsOf(stations) {
  const pairs = Math.floor(stations / 2);
  const left = Array.from({ length: pairs }, (_, i) => i + 1);
  const right = Array.from({ length: pairs }, (_, i) => 2 * pairs - i);
  return [left, right];
}

function Tile({ slabKey, block, current, stale }) {
  const { t, reason } = useWords();
  const verdict = known(block.verdict);
  const word = t(`verdict.${verdict}`);
  const why = verdict === 'pass' || verdict === 'none' ? '' : reason(block.reason, block.reason_text);
  const label = [
    t('map.block', { station: block.station, verdict: current ? t('map.current') : word }),
    current && verdict !== 'none' ? word : '',
    stale ? t('stale.last') : '',
    why,
  ].filter(Boolean).join(', ');
  const inside = html`
    <span class="tile-number">${block.station}</span>
    <span class="tile-symbol" aria-hidden="true">${current && verdict === 'none' ? '…' : symbol(verdict)}</span>
    <span class="tile-word">${current ? t('map.current') : verdict === 'none' ? '' : word}</span>`;
  const shared = {
    className: `tile v-${verdict}${current ? ' tile-current' : ''}`,
    'data-block': block.station,
    'data-verdict': verdict === 'aborted' ? 'not_measured' : verdict,
  };
  return slabKey
    ? html`<${Link} to=${`/slabs/${slabKey}/blocks/${block.station}`} aria-label=${label} title=${label} ...${shared}>${inside}<//>`
    : html`<div role="img" aria-label=${label} ...${shared}>${inside}</div>`;
}

/// `blocks`: {station, verdict, reason, reason_text}. `slabKey`: makes every tile a link to its block.
export function SlabMap({ blocks, slabKey = null, current = 0, stale = false, small = false }) {
  const { t } = useWords();
  const by_station = new Map(blocks.map((block) => [block.station, block]));
  const count = Math.max(0, ...by_station.keys());
  const rows = rowsOf(count + (count % 2));
  return html`<div class=${`slab-map${small ? ' slab-map-small' : ''}`} role="group" aria-label=${t('map.title')}>
    ${rows.map(
      (stations, i) => html`<div class="slab-row" key=${i}>
        <span class="row-name">${t(i === 0 ? 'map.row_left' : 'map.row_right')}</span>
        <ol class="tiles">
          ${stations.map(
            (station) => html`<li key=${station}>
              <${Tile} slabKey=${slabKey} current=${station === current} stale=${stale}
                block=${by_station.get(station) ?? { station, verdict: 'none', reason: 0 }} />
            </li>`,
          )}
        </ol>
      </div>`,
    )}
  </div>`;
}

export function Legend() {
  const { t } = useWords();
  return html`<ul class="legend" aria-label=${t('map.legend')}>
    ${['pass', 'fail', 'indeterminate', 'not_measured'].map(
      (verdict) => html`<li key=${verdict}><${VerdictMark} verdict=${verdict} /></li>`,
    )}
  </ul>`;
}

/// Blocks of a slab.slab_map/1 or slab/1 document in one form.
export function blocksOf(document) {
  if (Array.isArray(document?.station_verdicts) && document.station_verdicts.length > 0) return document.station_verdicts;
  const blocks = (document?.blocks ?? []).map((block) => ({
    ...block,
    verdict: block.final_verdict ?? block.verdict,
    reason: block.final_reason ?? block.reason,
  }));
  const stations = typeof document?.stations === 'number' ? document.stations : 0;
  for (let station = 1; station <= stations; ++station)
    if (!blocks.some((block) => block.station === station)) blocks.push({ station, verdict: 'none', reason: 0 });
  return blocks;
}
