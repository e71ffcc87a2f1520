// SPDX-License-Identifier: Apache-2.0
// Trends: capability of all characteristics, the control chart of one, yield by day, and what failed most often.
import { useDocument } from '../api.js';
import { decimalsOf, figure, kNone, limitsFigure, localTime } from '../figures.js';
import { html } from '../html.js';
import { ParetoChart, YieldChart } from '../parts/bars.js';
import { ControlChart } from '../parts/control_chart.js';
import { Loaded, PageHead, Panel } from '../parts/panel.js';
import { Table } from '../parts/table.js';
import { address, go, Link } from '../router.js';
import { Foreign, visible } from '../text.js';
import { useWords } from '../words.js';

const kJudged = { capable: ['✓', 'pass'], not_capable: ['✗', 'fail'], undecided: ['?', 'indeterminate'], not_judged: ['·', 'none'] };
const kSlabs = [50, 100, 200, 500, 1000, 5000];

const index = (estimate) => figure(estimate?.value ?? NaN, 2);

function Judgement({ row }) {
  const { t } = useWords();
  const name = row.judgement in kJudged ? row.judgement : 'not_judged';
  const [symbol, verdict] = kJudged[name];
  return html`<span class=${`verdict v-${verdict}`}><span class="verdict-symbol" aria-hidden="true">${symbol}</span> ${t(`judgement.${name}`)}</span>`;
}

function Capability({ capability, chosen, parameters }) {
  const { t, item } = useWords();
  const row_limits = (row) => (row.limits_differ ? t('trends.by_block') : limitsFigure({ ...row, value: null, verdict: 'none' }));
  const columns = [
    { head: t('field.item'), row: true, cell: (row) => html`<${Link} class="row-link" aria-current=${row.item === chosen ? 'true' : undefined}
        to=${address(`/trends/${row.item}`, { ...parameters, block: '' })}>${item(row.item)} <span class="unit">[${row.unit}]</span><//>` },
    { head: t('field.limits'), number: true, cell: row_limits },
    { head: t('trends.outside'), number: true, cell: (row) => `${row.performance.outside} / ${row.performance.values}` },
    { head: `${t('trends.at_most')}, %`, number: true, cell: (row) => figure(100 * (row.performance.outside_share.high ?? NaN), 2) },
    { head: 'Cp', number: true, cell: (row) => index(row.capability?.cp) },
    { head: 'Cpk', number: true, cell: (row) => index(row.capability?.cpk) },
    { head: 'Pp', number: true, cell: (row) => index(row.performance.pp) },
    { head: 'Ppk', number: true, cell: (row) => index(row.performance.ppk) },
    { head: t('trends.distribution'), cell: (row) => t(`distribution.${visible(row.performance.distribution, 20)}`) },
    { head: t('trends.signals'), number: true, cell: (row) => `${row.signals} / ${row.slabs}` },
    { head: t('trends.judgement'), cell: (row) => html`<${Judgement} row=${row} />` },
  ];
  return html`<${Table} caption=${t('trends.capability_caption', { type: capability.slab_type ?? kNone })} columns=${columns}
    rows=${capability.items} id=${(row) => row.item} rowClass=${(row) => (row.item === chosen ? 'row-chosen' : row.preliminary ? 'row-quiet' : '')}
    empty=${t('trends.none')} />`;
}

function Values({ trend }) {
  const { t } = useWords();
  const digits = decimalsOf(trend.unit);
  const columns = [
    { head: t('field.slab'), row: true, cell: (point) => html`<${Link} class="row-link" to=${`/slabs/${point.key}`}>
        <${Foreign} text=${point.slab_id || String(point.key)} max=${64} /><//>` },
    { head: t('field.began'), cell: (point) => html`<time class="time">${localTime(point.began, false)}</time>` },
    { head: t('field.value'), number: true, cell: (point) => figure(point.value, digits) },
    { head: t('trends.lowest'), number: true, cell: (point) => figure(point.lowest, digits) },
    { head: t('trends.highest'), number: true, cell: (point) => figure(point.highest, digits) },
    { head: t('trends.outside'), number: true, cell: (point) => point.outside },
    { head: t('trends.signal'), cell: (point) => (point.signal === 'none' ? '' : t(`signal.${visible(point.signal, 20)}`)) },
  ];
  return html`<details><summary>${t('app.table')}</summary>
    <${Table} caption=${t('trends.values_caption')} columns=${columns} rows=${trend.series.slice(-200).reverse()} id=${(point) => point.key} /></details>`;
}

function Stations({ trend }) {
  const { t } = useWords();
  const digits = decimalsOf(trend.unit);
  if (trend.stations.length === 0) return null;
  const columns = [
    { head: t('field.block'), row: true, number: true, cell: (station) => station.station },
    { head: t('trends.bias'), number: true, cell: (station) => figure(station.bias, digits) },
    { head: `± (k = 1)`, number: true, cell: (station) => figure(station.bias_sigma, digits) },
    { head: t('trends.drift'), number: true, cell: (station) => figure(station.drift, digits + 1) },
    { head: t('trends.judgement'), cell: (station) => [station.biased && t('trends.biased'), station.drifting && t('trends.drifting')]
        .filter(Boolean).map((text) => html`<span class="verdict v-indeterminate"><span aria-hidden="true">!</span> ${text} </span>`) },
  ];
  return html`<details><summary>${t('trends.stations')}</summary>
    <${Table} caption=${t('trends.stations')} columns=${columns} rows=${trend.stations} id=${(station) => station.station} /></details>`;
}

function Chart({ item, parameters, theme }) {
  const { t, item: name, language } = useWords();
  const ask = useDocument(address(`/trends/${item}`, { ...parameters, language }), 'slabd.trend/1');
  const title = t('trends.chart', { item: name(item) });
  const block = html`<label class="field"><span>${t('trends.block')}</span>
    <select value=${parameters.block ?? ''} onChange=${(event) => go(address(`/trends/${item}`, { ...parameters, block: event.target.value }), true)}>
      <option value="">${t('trends.all_blocks')}</option>
      ${Array.from({ length: 18 }, (_, i) => html`<option key=${i} value=${String(i + 1)}>${i + 1}</option>`)}
    </select></label>`;
  return html`<${Panel} title=${title} aside=${block}>
    <${Loaded} ask=${ask}>${(trend) => trend.series.length === 0 ? html`<p class="quiet">${t('trends.none')}</p>` : html`
      ${trend.preliminary && html`<p class="quiet">${t('trends.preliminary')}</p>`}
      ${trend.limits_differ && html`<p class="quiet">${t('trends.limits_differ')}</p>`}
      ${trend.other_limits > 0 && html`<p class="quiet">${t('trends.other_limits', { count: trend.other_limits })}</p>`}
      <${ControlChart} trend=${trend} theme=${theme} label=${t('trends.chart_label', { item: name(item), count: trend.series.length })} />
      <p><${Judgement} row=${trend} /> ${trend.judgement_reason && html`<span class="quiet"><${Foreign} text=${trend.judgement_reason} /></span>`}</p>
      <${Values} trend=${trend} /><${Stations} trend=${trend} />`}<//>
  <//>`;
}

function Yield() {
  const { t, language } = useWords();
  const ask = useDocument(`/yield?by=day&since=31d&language=${language}`, 'slabd.yield/1');
  const columns = [
    { head: t('yield.day'), row: true, cell: (day) => html`<span class="time">${day.group === 'all' ? t('yield.all') : day.group}</span>` },
    ...['inspected', 'passed', 'failed', 'undecided', 'not_measured'].map((field) => ({ head: t(`yield.${field}`), number: true, cell: (day) => day[field] })),
    { head: t('yield.percent'), number: true, cell: (day) => html`<strong>${figure(day.yield_percent, 1)}</strong>` },
    { head: t('yield.interval'), number: true, cell: (day) => `${figure(day.yield_low_percent, 1)} .. ${figure(day.yield_high_percent, 1)}` },
  ];
  return html`<${Panel} title=${t('yield.title')}><${Loaded} ask=${ask}>${(document) => html`
    <${YieldChart} groups=${document.groups.filter((day) => day.group !== 'all')} />
    <${Table} caption=${t('yield.caption')} hideCaption columns=${columns} rows=${[...document.groups].reverse()} id=${(day) => day.group} empty=${t('trends.none')} />`}<//><//>`;
}

function Reasons() {
  const { t, item, reason } = useWords();
  const ask = useDocument('/reasons?since=31d', 'slabd.reasons/1');
  const place = (row) => (row.station === null ? kNone : row.station_to ? `${row.station}-${row.station_to}` : row.station);
  const columns = [
    { head: '#', number: true, cell: (_, i) => i + 1 },
    { head: t('field.item'), row: true, cell: (row) => (row.item === 'block' ? reason(row.reason) : item(row.item)) },
    { head: t('field.block'), number: true, cell: place },
    { head: t('yield.failed'), number: true, cell: (row) => row.failed },
    { head: t('yield.undecided'), number: true, cell: (row) => row.undecided },
    { head: t('reasons.stopped'), number: true, cell: (row) => row.stopped },
    { head: t('reasons.count'), number: true, cell: (row) => html`<strong>${row.count}</strong>` },
    { head: t('reasons.share'), number: true, cell: (row) => figure(row.cumulative_percent, 1) },
  ];
  return html`<${Panel} title=${t('reasons.title')}><${Loaded} ask=${ask}>${(document) => document.reasons.length === 0
    ? html`<p class="quiet">${t('reasons.none')}</p>`
    : html`<${ParetoChart} reasons=${document.reasons} />
    <${Table} caption=${t('reasons.caption', { slabs: document.slabs })} hideCaption columns=${columns} rows=${document.reasons.slice(0, 30)} />`}<//><//>`;
}

export function Trends({ route, theme }) {
  const { t, language } = useWords();
  const legal = (name, pattern) => (pattern.test(route.query.get(name) ?? '') ? route.query.get(name) : '');
  const item = route.item ?? 'seat_slope';
  const parameters = { slabs: legal('slabs', /^[1-9]\d{1,4}$/) || '200', slab_type: legal('slab_type', /^[1-9]\d{0,4}$/), block: legal('block', /^([1-9]|1[0-8])$/) };
  const ask = useDocument(address('/trends', { ...parameters, block: '', language }), 'slabd.capability/1');
  return html`
    <${PageHead} title=${t('trends.title')}>
      <label class="field"><span>${t('trends.slabs')}</span>
        <select value=${parameters.slabs} onChange=${(event) => go(address(`/trends/${item}`, { ...parameters, slabs: event.target.value }), true)}>
          ${kSlabs.map((count) => html`<option key=${count} value=${String(count)}>${count}</option>`)}
        </select></label>
    <//>
    <${Chart} item=${item} parameters=${parameters} theme=${theme} />
    <${Panel} title=${t('trends.capability')}>
      <${Loaded} ask=${ask}>${(capability) => html`<${Capability} capability=${capability} chosen=${item} parameters=${parameters} />`}<//>
    <//>
    <div class="two"><${Yield} /><${Reasons} /></div>`;
}
