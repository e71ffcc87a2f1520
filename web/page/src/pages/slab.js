// SPDX-License-Identifier: Apache-2.0
// One stored slab: findings first, then the map, the slab's items, and what it was measured with.
import { useState } from 'preact/hooks';
import { kOpen_ms, useDocument, whileOpen } from '../api.js';
import { figure, localTime } from '../figures.js';
import { html } from '../html.js';
import { DecisionPanel, Dispositions } from '../parts/decision.js';
import { FindingList, findingsOf } from '../parts/findings.js';
import { BudgetTable, ItemTable } from '../parts/items.js';
import { Loaded, PageHead, Panel } from '../parts/panel.js';
import { ScansPanel } from '../parts/scans.js';
import { blocksOf, Legend, SlabMap } from '../parts/slab_map.js';
import { Facts, Table } from '../parts/table.js';
import { address, Link } from '../router.js';
import { Foreign, visible } from '../text.js';
import { VerdictMark } from '../verdict.js';
import { useWords } from '../words.js';
import { newsOf, reportAddress } from './slabs.js';

export function identityFacts(slab, words) {
  const { t } = words;
  const text = (value) => (value ? html`<${Foreign} text=${value} />` : t('app.none'));
  const fit = slab.slab_fit;
  return [
    [t('field.id'), text(slab.slab_id)],
    [t('field.no'), slab.slab_no],
    [t('field.key'), slab.key],
    [t('field.type'), slab.slab_type],
    [t('field.began'), localTime(slab.began)],
    [t('field.ended'), slab.ended ? localTime(slab.ended) : t('slab.still_open')],
    [t('field.acknowledged'), t(slab.acknowledged ? 'app.yes' : 'app.no')],
    [t('field.recipe'), html`<${Foreign} text=${slab.recipe} /> <span class="quiet hash">${slab.recipe_sha256.slice(0, 12)}</span>`],
    [t('field.calibration'), text(slab.calibration_id)],
    [t('field.stations'), text(slab.stations_id)],
    [t('field.scanner'), text(slab.scanner_id)],
    ...(slab.more_arms ?? []).flatMap((arm) => [
      [t('slab.further_scanner', { scanner: visible(arm.scanner, 16), robot: visible(arm.robot, 16) }),
        html`${text(arm.calibration_id)}, ${text(arm.stations_id)}, ${text(arm.scanner_id)}`],
    ]),
    slab.tie_id && [t('calibration.tie'), text(slab.tie_id)],
    [t('field.guard'), slab.guard === 0 ? t('slab.simple') : t('slab.guarded', { guard: slab.guard ?? '-' })],
    slab.slope_datum && [t('field.datum'), t(`datum.${visible(slab.slope_datum, 30)}`)],
    fit?.ok && [t('field.fit'), t('slab.fit', { seats: fit.seats, rms: figure(fit.rms_mm, 3) })],
    slab.slab_temperature_k !== null && [t('field.temperature'), `${figure(slab.slab_temperature_k - 273.15, 1)} °C`],
    slab.mould !== null && [t('field.mould'), html`<${Link} to=${`/moulds?mould=${slab.mould}`}>${slab.mould}<//>`],
    slab.design !== null && [t('field.design'), html`<span class="hash">${slab.design.sha256.slice(0, 12)}</span>`],
    slab.slab_age_h !== null && [t('field.age'), `${slab.slab_age_h} h`],
    [t('field.software'), text(slab.software)],
  ];
}

/// Verdict of a stored slab as a band.
export function SlabVerdict({ slab }) {
  const { t, reason } = useWords();
  return html`<div class=${`slab-verdict v-${slab.ended ? slab.verdict : 'none'}`} data-slab-verdict=${slab.ended ? slab.verdict : 'none'}>
    ${slab.ended ? html`<${VerdictMark} verdict=${slab.verdict} className="large" />` : html`<span>· ${t('slab.still_open')}</span>`}
    ${slab.reason ? html`<span>${reason(slab.reason)}</span>` : ''}
    ${slab.emulated && html`<span class="mark">${t('emulation.mark')}</span>`}
  </div>`;
}

/// Dimensions of the slab that only gauges measure.
const kOfGauges = ['slab_length', 'slab_width', 'slab_thickness', 'bottom_flatness'];

function Gauges({ gauges }) {
  const { t } = useWords();
  const columns = [
    { head: t('field.gauge'), row: true, cell: (gauge) => html`<${Foreign} text=${gauge.name} /> <span class="unit">[${gauge.unit}]</span>` },
    { head: t('field.source'), cell: (gauge) => html`<${Foreign} text=${gauge.source} />` },
    { head: t('field.measured'), number: true, cell: (gauge) => html`<strong>${figure(gauge.value, 3)}</strong>` },
    { head: t('field.value_age'), number: true, cell: (gauge) => figure(gauge.age_s, 1) },
    { head: t('field.check_deviation'), number: true, cell: (gauge) => figure(gauge.check_deviation, 3) },
    { head: t('field.gauge_state'), cell: (gauge) => (gauge.state === 'ok' ? '' : '! ') + t(`gauge_state.${visible(gauge.state, 30)}`) },
  ];
  return html`<${Panel} title=${t('slab.gauges')}><${Table} caption=${t('slab.gauges')} hideCaption columns=${columns} rows=${gauges}
    id=${(gauge) => gauge.name} /><//>`;
}

/// Items that did not pass first; the rest in the order of the document.
function ItemsOfSlab({ slab }) {
  const { t } = useWords();
  const [all, setAll] = useState(false);
  const [budget, setBudget] = useState(false);
  const odd = slab.items.filter((item) => item.verdict !== 'pass' && item.verdict !== 'none');
  const shown = all ? slab.items : odd;
  const unseen = kOfGauges.filter((id) => !slab.items.some((item) => item.id === id && item.value !== null));
  return html`<${Panel} title=${t('slab.items')} aside=${html`<div class="buttons">
      <button type="button" aria-pressed=${String(all)} onClick=${() => setAll(!all)}>${t('slab.all_items')} (${slab.items.length})</button>
      <button type="button" aria-pressed=${String(budget)} onClick=${() => setBudget(!budget)}>${t('slab.budget')}</button></div>`}>
    ${slab.verdict === 'aborted' && html`<p>${t('slab.aborted')}</p>`}
    <${ItemTable} caption=${t('slab.items')} items=${shown} ofSlab empty=${t('live.no_findings')} />
    ${budget && html`<${BudgetTable} items=${shown.length > 0 ? shown : slab.items} ofSlab />`}
    ${unseen.length > 0 && html`<p class="quiet">${t('slab.not_visible', { unseen: unseen.map((id) => t(`unseen.${id}`)).join(', ') })}</p>`}
  <//>`;
}

function BlocksAndTimes({ slab }) {
  const { t, reason } = useWords();
  const seconds = (ms) => figure(ms === null || ms === undefined ? NaN : ms / 1000, 2);
  const columns = [
    { head: t('field.block'), row: true, number: true, cell: (block) => html`<${Link} class="row-link"
        to=${`/slabs/${slab.key}/blocks/${block.station}`}>${block.station}<//>` },
    { head: t('field.attempts'), number: true, cell: (block) => block.attempt },
    { head: t('slab.settled'), number: true, cell: (block) => seconds(block.settle_ms) },
    { head: t('slab.acquired'), number: true, cell: (block) => seconds(block.acquire_ms) },
    { head: t('slab.computed'), number: true, cell: (block) => figure(block.result?.timing_ms?.total ?? NaN, 0) },
    { head: t('field.verdict'), cell: (block) => html`<${VerdictMark} verdict=${block.final_verdict} />` },
    { head: t('field.reason'), cell: (block) => (block.final_reason ? html`<span class="reason">${reason(block.final_reason)}</span>` : '') },
  ];
  return html`<${Table} caption=${t('slab.blocks')} hideCaption columns=${columns} rows=${slab.blocks}
    id=${(block) => `${block.station} ${block.attempt}`} />`;
}

export function Slab({ route, picture }) {
  const words = useWords();
  const { t, language } = words;
  const row = picture.status?.last?.find((one) => String(one.key) === route.key);
  const ask = useDocument(`/slabs/${route.key}`, 'slabd.slab/1', { every_ms: whileOpen, news: newsOf(row) });
  const map = useDocument(`/slabs/${route.key}/map?language=${language}`, 'slabd.slab_map/1',
    { every_ms: (map) => (map.ended_utime_us === null ? kOpen_ms : 0) });
  const slab = ask.document;
  const name = slab ? visible(slab.slab_id || slab.slab_no, 64) : route.key;
  return html`
    <nav class="way" aria-label=${t('page.slabs')}><${Link} to="/slabs">← ${t('page.slabs')}<//></nav>
    <${PageHead} title=${t('page.slab', { name })}>
      ${slab && html`<div class="buttons">
        <a class="button" href=${reportAddress(slab.key, language, false)} target="_blank" rel="noopener">${t('slab.report')}</a>
        <a class="button" href=${reportAddress(slab.key, language, true)} target="_blank" rel="noopener">${t('slab.report_full')}</a>
        <${Link} class="button" to=${address('/compare', { a: slab.key })}>${t('slab.compare')}<//>
      </div>`}
    <//>
    <${Loaded} ask=${ask}>${(slab) => html`
      <${SlabVerdict} slab=${slab} />
      <${Dispositions} slab=${slab} />
      <div class="two">
        <${Panel} title=${t('slab.findings')}>
          <${Loaded} ask=${map}>${(map) => html`<${FindingList} findings=${findingsOf(map, words)} count=${map.findings_count} slabKey=${slab.key}
            empty=${t(map.ended_utime_us === null ? 'live.no_findings' : 'slab.no_findings')} />`}<//>
          ${slab.unconfirmed > 0 && html`<p class="warning-line"><span aria-hidden="true">! </span>${t('slab.unconfirmed', { count: slab.unconfirmed })}</p>`}
        <//>
        <${Panel} title=${t('slab.map')}><${SlabMap} blocks=${blocksOf(slab)} slabKey=${slab.key} small /><${Legend} /><//>
      </div>
      <${DecisionPanel} slab=${slab} again=${ask.again} />
      <${ItemsOfSlab} slab=${slab} />
      ${slab.gauges.length > 0 && html`<${Gauges} gauges=${slab.gauges} />`}
      <div class="two">
        <${Panel} title=${t('slab.identity')}><${Facts} facts=${identityFacts(slab, words)} /><//>
        <${Panel} title=${t('slab.blocks')}><${BlocksAndTimes} slab=${slab} /><//>
      </div>
      <${ScansPanel} slab=${slab} />`}<//>`;
}
