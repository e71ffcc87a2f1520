// SPDX-License-Identifier: Apache-2.0
// The line: its links with what to do, the doctor's checks (what needs attention first), counters, and the daemon itself.
import { useState } from 'preact/hooks';
import { useDocument } from '../api.js';
import { duration, figure } from '../figures.js';
import { html } from '../html.js';
import { armsOf, LinkTable, nameOfLink } from '../parts/links.js';
import { Loaded, PageHead, Panel } from '../parts/panel.js';
import { Facts, Table } from '../parts/table.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';

const kOrder = ['failed', 'unknown', 'warning', 'note', 'ok'];
const kMarks = { failed: ['✗', 'fail'], warning: ['!', 'indeterminate'], note: ['i', 'none'], unknown: ['?', 'not_measured'], ok: ['✓', 'pass'] };
const healthOf = (word) => (kOrder.includes(word) ? word : word === 'fail' || word === 'FAILED' ? 'failed' : 'unknown');

function Findings({ findings }) {
  const { t, check } = useWords();
  const [all, setAll] = useState(false);
  const sorted = findings.map((finding) => ({ ...finding, health: healthOf(finding.health) }))
    .sort((a, b) => kOrder.indexOf(a.health) - kOrder.indexOf(b.health));
  const attention = sorted.filter((finding) => finding.health !== 'ok');
  const columns = [
    { head: t('field.state'), cell: (finding) => html`<span class=${`verdict v-${kMarks[finding.health][1]}`}>
        <span class="verdict-symbol" aria-hidden="true">${kMarks[finding.health][0]}</span> ${t(`health.${finding.health}`)}</span>` },
    { head: t('field.check'), row: true, cell: (finding) => check(finding.check) },
    { head: t('field.saw'), cell: (finding) => html`<span class="sentence"><${Foreign} text=${finding.saw} max=${1000} /></span>` },
    { head: t('field.cure'), cell: (finding) => (finding.cure ? html`<span class="sentence">→ <${Foreign} text=${finding.cure} max=${1000} /></span>` : '') },
  ];
  return html`${attention.length === 0 && html`<p>✓ ${t('line.all_good')}</p>`}
    <${Table} caption=${t('line.doctor_caption')} hideCaption columns=${columns} rows=${all ? sorted : attention} />
    <p><button type="button" aria-pressed=${String(all)} onClick=${() => setAll(!all)}>${t('line.show_ok', { count: findings.length - attention.length })}</button></p>`;
}

/// Counters of the links that are numbers; those above zero that mean trouble are marked by the daemon's own text.
function Counters({ status }) {
  const { t } = useWords();
  const arms = armsOf(status);
  const links = [
    { name: 'plc', part: '', of: status?.links?.plc },
    ...arms.map((arm) => ({ name: 'robot', part: arm.robot, of: arm.pose })),
    ...arms.map((arm) => ({ name: 'scanner', part: arm.scanner, of: arm.link })),
    { name: 'store', part: '', of: status?.links?.store },
  ];
  const rows = links.flatMap(({ name, part, of }) =>
    Object.entries(of ?? {}).filter(([, value]) => typeof value === 'number' && Number.isFinite(value))
      .map(([counter, value]) => ({ name, part, counter, value })));
  const columns = [
    { head: t('line.links'), cell: (row) => nameOfLink(t, row) },
    { head: t('line.counters'), row: true, cell: (row) => html`<code>${row.counter}</code>` },
    { head: t('field.value'), number: true, cell: (row) => figure(row.value, Number.isInteger(row.value) ? 0 : 3) },
  ];
  return html`<${Table} caption=${t('line.counters_caption')} columns=${columns} dense rows=${rows} id=${(row) => `${row.name} ${row.part} ${row.counter}`} />`;
}

export function daemonFacts(status, words) {
  const { t, units } = words;
  if (!status) return [];
  const mb = (bytes) => figure(bytes / 1e6, 0);
  return [
    [t('field.software'), html`<${Foreign} text=${status.software} />`],
    [t('line.uptime'), duration(status.uptime_s ?? NaN, units)],
    [t('line.session'), status.session],
    [t('line.blocks'), t('line.blocks_text', { count: status.blocks.measured, last: figure(status.blocks.last_ms, 0), longest: figure(status.blocks.max_ms, 0) })],
    [t('line.pending'), status.results_pending],
    [t('line.commit'), t('line.commit_text', { last: figure(status.links.store.commit_last_ms, 1), longest: figure(status.links.store.commit_max_ms, 1) })],
    [t('line.memory'), t('line.memory_text', { now: mb(status.memory.rss_kb * 1024), peak: mb(status.memory.peak_kb * 1024), inspection: mb(status.memory.inspection_bytes) })],
    ...armsOf(status).filter((arm) => arm.scanner !== '' && typeof arm.temperature_c === 'number')
      .map((arm) => [t('line.temperature', { scanner: arm.scanner }), `${figure(arm.temperature_c, 1)} °C`]),
    status.chain && [t('line.chain'), html`${t('line.chain_text', { entries: status.chain.entries, sha: '' })}<code class="hash">${status.chain.sha256}</code>`],
    [t('line.database'), html`<${Foreign} text=${status.db} />`],
    [t('line.config'), html`<${Foreign} text=${status.config} />`],
  ];
}

export function Line({ picture, since }) {
  const words = useWords();
  const { t, language } = words;
  const status = picture.status?.status;
  const ask = useDocument(`/doctor?language=${language}`, 'slabd.doctor/1');
  return html`
    <${PageHead} title=${t('line.title')} />
    <${Panel} title=${t('line.links')}><${LinkTable} status=${status} since=${since} caption=${t('line.links_caption')} now_ms=${performance.now()} /><//>
    <${Panel} title=${t('line.doctor')} aside=${html`<button type="button" onClick=${ask.again}>${t('line.doctor_again')}</button>`}>
      ${ask.loading && html`<p class="quiet">${t('line.doctor_wait')}</p>`}
      <${Loaded} ask=${ask}>${(document) => html`<${Findings} findings=${document.findings} />`}<//>
    <//>
    <div class="two">
      <${Panel} title=${t('line.daemon')}><${Facts} facts=${daemonFacts(status, words)} /><//>
      <${Panel} title=${t('line.counters')}><${Counters} status=${status} /><//>
    </div>`;
}
