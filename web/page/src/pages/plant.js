// SPDX-License-Identifier: Apache-2.0
// The plant: its lines side by side, findings and moulds of all lines, and a slab wherever it was measured.
import { useEffect, useState } from 'preact/hooks';
import { useDocument } from '../api.js';
import { figure, kNone, localTime } from '../figures.js';
import { html } from '../html.js';
import { Field } from '../parts/field.js';
import { Loaded, PageHead, Panel } from '../parts/panel.js';
import { Table } from '../parts/table.js';
import { address, go } from '../router.js';
import { Foreign } from '../text.js';
import { known } from '../verdict.js';
import { useWords } from '../words.js';

const kDays = ['7', '30', '90', '365'];
const kDaysAtFirst = '30';
const timeOf = (utime_us) => (utime_us === null ? kNone : html`<time class="time">${localTime(new Date(utime_us / 1000).toISOString())}</time>`);
const percent = (part, all) => (all === 0 ? kNone : figure((100 * part) / all, 1));
const blockOf = (row) => (row.station === 0 ? kNone : row.station_to ? `${row.station}-${row.station_to}` : row.station);

/// Days, newest first, with {first, passed} of each line.
export function byDay(rows) {
  const days = new Map();
  for (const row of rows) days.set(row.day, { ...days.get(row.day), [row.line]: row });
  return [...days].sort(([a], [b]) => (a < b ? 1 : -1)).map(([day, lines]) => ({ day, lines }));
}

function Lines({ lines }) {
  const { t } = useWords();
  return html`<${Table} caption=${t('plant.lines_caption')} rows=${lines} empty=${t('plant.no_line')} id=${(one) => one.line} columns=${[
    { head: t('page.line'), row: true, cell: (one) => html`<${Foreign} text=${one.line} />` },
    { head: t('page.slabs'), number: true, cell: (one) => one.slabs },
    { head: t('yield.inspected'), number: true, cell: (one) => one.first },
    { head: t('yield.passed'), number: true, cell: (one) => one.passed },
    { head: t('yield.percent'), number: true, cell: (one) => html`<strong>${percent(one.passed, one.first)}</strong>` },
    { head: t('plant.newest'), cell: (one) => timeOf(one.newest_utime_us) },
    { head: t('plant.received'), cell: (one) => timeOf(one.received_utime_us) },
    { head: t('plant.troubles'), number: true, cell: (one) => (one.troubles === 0 ? 0 : html`<strong class="verdict v-fail"><span aria-hidden="true">✗ </span>${one.troubles}</strong>`) },
  ]} />`;
}

function Days({ document }) {
  const { t } = useWords();
  const lines = document.lines.map((one) => one.line);
  return html`<${Table} caption=${t('plant.days_caption')} rows=${byDay(document.days_of).slice(0, 31)} empty=${t('plant.no_slab')} id=${(one) => one.day} columns=${[
    { head: t('yield.day'), row: true, cell: (one) => one.day },
    ...lines.map((line) => ({
      head: html`<${Foreign} text=${line} />`, number: true,
      cell: (one) => (one.lines[line] ? html`${percent(one.lines[line].passed, one.lines[line].first)} <span class="quiet">(${one.lines[line].first})</span>` : kNone),
    })),
  ]} />`;
}

function Pareto({ rows }) {
  const { t, item } = useWords();
  return html`<${Table} caption=${t('plant.pareto_caption')} rows=${rows} empty=${t('plant.no_finding')} id=${(one) => `${one.line} ${one.item}`} columns=${[
    { head: t('field.item'), row: true, cell: (one) => item(one.item) },
    { head: t('page.line'), cell: (one) => html`<${Foreign} text=${one.line} />` },
    { head: t('yield.failed'), number: true, cell: (one) => html`<strong>${one.failed}</strong>` },
    { head: t('yield.undecided'), number: true, cell: (one) => one.indeterminate },
    { head: t('yield.not_measured'), number: true, cell: (one) => one.not_measured },
    { head: t('page.slabs'), number: true, cell: (one) => one.slabs },
  ]} />`;
}

function Moulds({ rows }) {
  const { t, item } = useWords();
  return html`<${Table} caption=${t('plant.moulds_caption')} rows=${rows} empty=${t('moulds.none')} id=${(one) => `${one.mould} ${one.slab_type} ${one.item}`} columns=${[
    { head: t('field.mould'), row: true, cell: (one) => one.mould },
    { head: t('field.type'), number: true, cell: (one) => one.slab_type },
    { head: t('field.item'), cell: (one) => item(one.item) },
    { head: t('field.deviation'), number: true, cell: (one) => html`<strong>${figure(one.mean, 4)}</strong>` },
    { head: t('plant.sd'), number: true, cell: (one) => figure(one.sd, 4) },
    { head: 'n', number: true, cell: (one) => one.n },
    { head: t('plant.lines'), number: true, cell: (one) => one.lines },
  ]} />`;
}

function Found({ id }) {
  const { t, item, reason } = useWords();
  const ask = useDocument(address('/plant/slab', { id }), 'slabd.plant_found/1');
  return html`<${Loaded} ask=${ask}>${(found) => (found.slabs.length === 0
    ? html`<p class="quiet">${t('plant.not_found')}</p>`
    : found.slabs.map((slab) => html`<section key=${`${slab.line} ${slab.slab_key}`}>
        <h3><${Foreign} text=${slab.line} />: <strong class=${`verdict v-${known(slab.verdict)}`}>${t(`verdict.${known(slab.verdict)}`)}</strong>
          ${' '}${timeOf(slab.ended_utime_us)}</h3>
        <p class="quiet">${slab.reason !== 0 && html`<${Foreign} text=${reason(slab.reason, '')} /> · `}${slab.disposition !== null && html`${t(`disposition.${slab.disposition}`)} · `}<${Foreign} text=${slab.software} /></p>
        <${Table} caption=${t('plant.found_caption')} rows=${slab.items} empty=${t('plant.all_passed')} id=${(one) => `${one.item} ${one.station} ${one.station_to}`} columns=${[
          { head: t('field.item'), row: true, cell: (one) => item(one.item) },
          { head: t('field.block'), number: true, cell: blockOf },
          { head: t('field.verdict'), cell: (one) => t(`verdict.${known(one.verdict)}`) },
          { head: t('field.value'), number: true, cell: (one) => figure(one.value, 4) },
          { head: t('field.limits'), number: true, cell: (one) => `${figure(one.lower, 4)} … ${figure(one.upper, 4)}` },
          { head: 'U', number: true, cell: (one) => figure(one.u, 4) },
        ]} /></section>`))}<//>`;
}

export function Plant({ route }) {
  const { t } = useWords();
  const days = kDays.includes(route.query.get('days')) ? route.query.get('days') : kDaysAtFirst;
  const id = (route.query.get('id') ?? '').slice(0, 32);
  const [wanted, setWanted] = useState(id);
  // The browser's back button changes the address.
  useEffect(() => setWanted(id), [id]);
  const ask = useDocument(address('/plant', { days }), 'slabd.plant_overview/1');
  return html`
    <${PageHead} title=${t('plant.title')} />
    <form class="filters" aria-label=${t('plant.find')} onSubmit=${(event) => { event.preventDefault(); go(address('/plant', { days, id: wanted.trim() })); }}>
      <${Field} label=${t('plant.days')}><select value=${days} onChange=${(event) => go(address('/plant', { days: event.target.value, id }))}>
        ${kDays.map((count) => html`<option key=${count} value=${count}>${count}</option>`)}</select><//>
      <${Field} label=${t('slabs.id')}><input type="search" value=${wanted} maxlength="32" autocomplete="off" spellcheck=${false}
        onInput=${(event) => setWanted(event.target.value)} /><//>
      <button type="submit">${t('plant.find')}</button>
    </form>
    ${id !== '' && html`<${Panel} title=${t('plant.found', { id })}><${Found} key=${id} id=${id} /><//>`}
    <${Loaded} ask=${ask}>${(document) => html`
      <${Panel} title=${t('plant.lines')}><${Lines} lines=${document.lines} /><//>
      <${Panel} title=${t('yield.title')}><${Days} document=${document} /><//>
      <${Panel} title=${t('plant.pareto')}><${Pareto} rows=${document.pareto} /><//>
      <${Panel} title=${t('page.moulds')}><${Moulds} rows=${document.moulds} /><//>`}<//>`;
}
