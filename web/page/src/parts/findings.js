// SPDX-License-Identifier: Apache-2.0
// Findings of a slab: what did not pass, with place, value, limits and U. The sentences are those of the reports
// (slabd.slab_map/1, from report/findings.h), so that page, terminal and PDF say the same.
import { html } from '../html.js';
import { Link } from '../router.js';
import { Foreign } from '../text.js';
import { known, symbol } from '../verdict.js';
import { useWords } from '../words.js';

const kBad = ['fail', 'not_measured', 'aborted', 'indeterminate'];

/// True if a block or the slab did not pass: then "no findings" would be wrong.
export function isBad(map) {
  return [map, ...(map.blocks ?? [])].some((one) => kBad.includes(one.verdict));
}

/// Findings of a map; of one without sentences, its blocks that did not pass.
export function findingsOf(map, words) {
  const findings = map?.findings ?? [];
  if (findings.length > 0 || !map || !isBad(map)) return findings;
  return map.blocks.filter((block) => kBad.includes(block.verdict)).map((block) => ({
    verdict: block.verdict,
    stations: [block.station],
    text: `${words.t('page.block', { station: block.station })}: ${words.reason(block.reason, block.reason_text)}`,
  }));
}

/// `slabKey`: a finding of one block is a link to it. `count`: number of findings if the document has fewer.
export function FindingList({ findings, slabKey = null, max = Infinity, count = findings.length, empty }) {
  const { t } = useWords();
  if (findings.length === 0) return html`<p class="quiet">${empty}</p>`;
  const shown = findings.slice(0, max);
  const rest = Math.max(count, findings.length) - shown.length;
  return html`<ul class="findings">
    ${shown.map((finding, i) => {
      const verdict = known(finding.verdict);
      const text = html`<${Foreign} text=${finding.text} max=${600} />`;
      return html`<li key=${i} class=${`finding v-${verdict}`}>
        <span class="finding-mark"><span aria-hidden="true">${symbol(verdict)}</span>
          <span class="for-readers">${t(`verdict.${verdict}`)}</span></span>
        ${slabKey && finding.stations?.length === 1
          ? html`<${Link} class="finding-text" to=${`/slabs/${slabKey}/blocks/${finding.stations[0]}`}>${text}<//>`
          : html`<span class="finding-text">${text}</span>`}
      </li>`;
    })}
    ${rest > 0 && html`<li class="quiet">${t('live.more_findings', { count: rest })}</li>`}
  </ul>`;
}
