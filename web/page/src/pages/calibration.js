// SPDX-License-Identifier: Apache-2.0
// Calibration: what is in force, when the next check is due, the checks, the changes and the records. Read only. On a line
// with several scanners a tab for each, and the tie of the robots.
import { useState } from 'preact/hooks';
import { useDocument } from '../api.js';
import { figure, kNone, localTime } from '../figures.js';
import { html } from '../html.js';
import { armsOf } from '../parts/links.js';
import { Loaded, PageHead, Panel } from '../parts/panel.js';
import { Facts, Table } from '../parts/table.js';
import { Foreign, visible } from '../text.js';
import { useWords } from '../words.js';

const text = (value) => (value ? html`<${Foreign} text=${value} />` : kNone);

function Passed({ passed }) {
  const { t } = useWords();
  if (passed === null) return kNone;
  return html`<span class=${`verdict v-${passed ? 'pass' : 'fail'}`}><span aria-hidden="true">${passed ? '✓' : '✗'}</span> ${
    t(passed ? 'calibration.passed' : 'calibration.failed')}</span>`;
}

function InForce({ now }) {
  const { t } = useWords();
  if (!now) return html`<p class="quiet">${t('calibration.no_state')}</p>`;
  const until = (utime_us) => (utime_us ? localTime(utime_us) : t('app.never'));
  const reference = (name) => {
    const one = now[name];
    if (!one) return [t(`calibration.${name}`), t('calibration.not_there')];
    return [t(`calibration.${name}`), html`${text(one.id)} <${Passed} passed=${one.passed} />
      ${one.note && html`<div class="quiet">${text(one.note)}</div>`}
      <div>${t('field.due')}: ${until(one.due_utime_us)} ${one.overdue && html`<strong class="verdict v-fail">! ${t('calibration.overdue')}</strong>`}</div>`];
  };
  return html`<${Facts} facts=${[
    [t('calibration.hand_eye'), html`${text(now.id)} (${t(`source.${visible(now.source, 20)}`)})
      <div class="quiet">${t('field.expires')}: ${until(now.expires_utime_us)}</div>`],
    [t('calibration.stations'), now.stations.length === 0 ? t('calibration.not_there') : now.stations.map((one) => html`<div key=${one.slab_type}>
      ${t('calibration.stations_text', { type: one.slab_type, mastered: one.mastered, state: t(`corrections.${visible(one.state, 20)}`) })}</div>`)],
    [t('calibration.scanner'), now.scanner ? html`${text(now.scanner.id)} (${t(`scanner.${visible(now.scanner.state, 20)}`)})
      <div class="quiet">${t('field.expires')}: ${until(now.scanner.expires_utime_us)}</div>` : t('calibration.not_there')],
    reference('reference_block'),
    reference('monitor_ball'),
  ]} />`;
}

function Checks({ checks }) {
  const { t } = useWords();
  const columns = [
    { head: t('field.when'), row: true, cell: (check) => html`<time class="time">${localTime(check.time)}</time>` },
    { head: t('field.kind'), cell: (check) => html`<span class="time">${t(`kind.${visible(check.kind, 20)}`)}</span>` },
    { head: t('field.result'), cell: (check) => html`<${Passed} passed=${check.passed} />` },
    { head: t('calibration.slope'), number: true, cell: (check) => figure(check.slope_deg, 4) },
    { head: 'U', number: true, cell: (check) => figure(check.slope_U_deg, 4) },
    { head: t('calibration.jaw'), number: true, cell: (check) => figure(check.jaw_distance_mm, 3) },
    { head: 'U', number: true, cell: (check) => figure(check.jaw_distance_U_mm, 3) },
    { head: t('calibration.off'), number: true, cell: (check) => (check.off_mm ?? []).some((part) => part !== null)
        ? check.off_mm.map((part) => figure(part, 3)).join(' ') : kNone },
    { head: t('field.who'), cell: (check) => text(check.who) },
    { head: t('field.note'), cell: (check) => html`<span class="sentence">${text(check.note)}</span>` },
  ];
  return html`<${Table} caption=${t('calibration.checks_caption')} columns=${columns} rows=${checks} empty=${t('calibration.no_checks')} />`;
}

function Changes({ changes }) {
  const { t } = useWords();
  const columns = [
    { head: t('field.when'), row: true, cell: (change) => html`<time class="time">${localTime(change.time)}</time>` },
    { head: t('field.kind'), cell: (change) => `${t(`kind.${visible(change.kind, 20)}`)}${change.slab_type ? ` ${change.slab_type}` : ''}` },
    { head: t('field.action'), cell: (change) => t(`action.${visible(change.action, 20)}`) },
    { head: t('field.calibration'), cell: (change) => text(change.id) },
    { head: t('field.who'), cell: (change) => text(change.who) },
    { head: t('field.why'), cell: (change) => html`<span class="sentence">${text(change.why)}</span>` },
  ];
  return html`<${Table} caption=${t('calibration.changes_caption')} columns=${columns} rows=${changes} empty=${t('calibration.no_changes')} />`;
}

function Records({ records }) {
  const { t } = useWords();
  const columns = [
    { head: t('field.calibration'), row: true, cell: (record) => text(record.id) },
    { head: t('field.kind'), cell: (record) => `${t(`kind.${visible(record.kind, 20)}`)}${record.slab_type ? ` ${record.slab_type}` : ''}` },
    { head: t('calibration.created'), cell: (record) => html`<time class="time">${localTime(record.created)}</time>` },
    { head: t('field.expires'), cell: (record) => (record.expires ? html`<time class="time">${localTime(record.expires)}</time>` : t('app.never')) },
    { head: t('calibration.operator'), cell: (record) => text(record.operator) },
  ];
  return html`<${Table} caption=${t('calibration.records_caption')} columns=${columns} rows=${records} empty=${t('calibration.no_records')} />`;
}

/// Rows of this scanner, and those that belong to no scanner: the tie.
const rowsOf = (rows, scanner) =>
  (rows ?? []).filter((row) => scanner === '' || row.kind === 'tie' || (row.scanner ?? scanner) === scanner);

function Tie({ tie }) {
  const { t } = useWords();
  if (!tie) return html`<p>✗ ${t('calibration.no_tie')}</p>`;
  return html`<${Facts} facts=${[
    [t('field.calibration'), text(tie.id)],
    [t('calibration.tied_robot'), text(tie.robot)],
    [t('field.expires'), tie.expires_utime_us ? localTime(tie.expires_utime_us) : t('app.never')],
    tie.trouble && [t('field.note'), html`<strong class="verdict v-fail">! ${text(tie.trouble)}</strong>`],
  ]} />`;
}

export function Calibration({ picture }) {
  const { t, language } = useWords();
  const ask = useDocument(`/calibration?language=${language}`, 'slabd.web_calibration/1');
  const status = picture.status?.status;
  const arms = armsOf(status);
  const [chosen, choose] = useState(0);
  const arm = arms[chosen] ?? arms[0];
  const trendOf = (document) => document.further_trends?.find((one) => one.scanner === arm.scanner)?.trend ?? document.trend;
  const inForce = ({ state }) =>
    (arm.scanner === '' ? state?.in_force : state?.arms?.find((one) => one.scanner === arm.scanner)?.in_force ?? arm.calibration);
  return html`
    <${PageHead} title=${t('calibration.title')} />
    <p class="quiet">${t('calibration.read_only')}</p>
    ${arms.length > 1 && html`<div class="buttons" role="group" aria-label=${t('calibration.arms')}>${arms.map((one, i) => html`
      <button type="button" key=${one.scanner} data-scanner=${one.scanner} aria-pressed=${String(one === arm)} onClick=${() => choose(i)}>${
        t('calibration.arm', { scanner: one.scanner, robot: one.robot })}</button>`)}</div>`}
    <${Loaded} ask=${ask}>${(document) => html`
      <${Panel} title=${t('calibration.in_force')}><${InForce} now=${inForce(document)} /><//>
      ${arms.length > 1 && html`<${Panel} title=${t('calibration.tie')}><${Tie} tie=${status.tie} /><//>`}
      <${Panel} title=${t('calibration.checks')}><${Checks} checks=${trendOf(document)?.checks ?? []} /><//>
      <${Panel} title=${t('calibration.changes')}><${Changes} changes=${rowsOf(document.history?.applied, arm.scanner)} /><//>
      <${Panel} title=${t('calibration.records')}><${Records} records=${rowsOf(document.history?.records, arm.scanner)} /><//>`}<//>`;
}
