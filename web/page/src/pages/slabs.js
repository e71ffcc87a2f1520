// SPDX-License-Identifier: Apache-2.0
// Stored slabs with the filters of slabctl history. The filters are in the address, so that a list can be bookmarked and
// the browser's back button returns to it.
import { useEffect, useState } from 'preact/hooks';
import { kApi, useDocument } from '../api.js';
import { localTime } from '../figures.js';
import { html } from '../html.js';
import { Loaded, PageHead } from '../parts/panel.js';
import { SlabRows } from '../parts/slab_rows.js';
import { address, go } from '../router.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';

const kFields = ['id', 'since', 'until', 'slab_type', 'verdict', 'block', 'item', 'limit'];
const kStep = 50;
const kMost = 2000;
export const kItems = ['seat_slope', 'seat_flatness', 'jaw_angle_inner', 'jaw_angle_outer', 'jaw_distance', 'casing_spacing',
  'casing_protrusion_inner', 'casing_protrusion_outer', 'casing_skew_inner', 'casing_skew_outer', 'seat_lateral',
  'seat_vertical', 'seat_spacing', 'large_jaw_distance', 'corner_level', 'warp_left', 'warp_right', 'seat_std',
  'surface_pores', 'block_damage'];

/// The filters that the address contains, only those that have a legal form.
export function filtersOf(query) {
  const legal = {
    id: /^[\x20-\x7e]{1,32}$/,
    since: /^(\d{1,4}[dhm]|\d{4}-\d{2}-\d{2})$/,
    until: /^\d{4}-\d{2}-\d{2}$/,
    slab_type: /^[1-9]\d{0,4}$/,
    verdict: /^(pass|fail|indeterminate|not_measured|aborted)$/,
    block: /^([1-9]|1[0-8])$/,
    item: /^[a-z_]{3,40}$/,
    limit: /^[1-9]\d{0,3}$/,
  };
  const filters = {};
  for (const field of kFields) {
    const value = query.get(field) ?? '';
    if (legal[field].test(value)) filters[field] = value;
  }
  return filters;
}

function Select({ label, value, options, set }) {
  return html`<label class="field"><span>${label}</span>
    <select value=${value} onChange=${(event) => set(event.target.value)}>
      ${options.map(([name, text]) => html`<option key=${name} value=${name}>${text}</option>`)}
    </select></label>`;
}

/// What the status has about a slab in a row of its newest slabs: a document of the slab is old if this has changed.
export const newsOf = (row) => (row ? `${row.key} ${row.verdict} ${row.disposition}` : '');

export function Slabs({ route, picture }) {
  const { t, item } = useWords();
  const filters = filtersOf(route.query);
  const [id, setId] = useState(filters.id ?? '');
  const limit = Math.min(kMost, Number(filters.limit ?? kStep));
  const ask = useDocument(address('/slabs', { ...filters, limit }), 'slabd.history/1', {
    news: (picture.status?.last ?? []).map(newsOf).join() });
  // The browser's back button changes the address.
  useEffect(() => setId(filters.id ?? ''), [filters.id]);
  const set = (change, replace = false) => go(address('/slabs', { ...filters, limit: '', ...change }), replace);
  const any = ['', t('slabs.any')];
  const verdicts = ['pass', 'fail', 'indeterminate', 'not_measured', 'aborted'];
  return html`
    <${PageHead} title=${t('slabs.title')} />
    <form class="filters" aria-label=${t('slabs.filter')} onSubmit=${(event) => { event.preventDefault(); set({ id: id.trim() }); }}>
      <label class="field"><span>${t('slabs.id')}</span>
        <input type="search" value=${id} maxlength="32" autocomplete="off" spellcheck=${false}
          onInput=${(event) => setId(event.target.value)} onChange=${(event) => set({ id: event.target.value.trim() })} /></label>
      <${Select} label=${t('slabs.since')} value=${filters.since ?? ''} set=${(since) => set({ since })}
        options=${[['', t('slabs.all_time')], ['24h', t('slabs.today')], ['7d', t('slabs.week')], ['30d', t('slabs.month')], ['90d', t('slabs.quarter')]]} />
      <label class="field"><span>${t('slabs.until')}</span>
        <input type="date" value=${filters.until ?? ''} onChange=${(event) => set({ until: event.target.value })} /></label>
      <label class="field field-short"><span>${t('slabs.type')}</span>
        <input type="text" inputmode="numeric" value=${filters.slab_type ?? ''} maxlength="5"
          onChange=${(event) => set({ slab_type: event.target.value.trim() })} /></label>
      <${Select} label=${t('slabs.verdict')} value=${filters.verdict ?? ''} set=${(verdict) => set({ verdict })}
        options=${[any, ...verdicts.map((name) => [name, t(`verdict.${name}`)])]} />
      <${Select} label=${t('slabs.block')} value=${filters.block ?? ''} set=${(block) => set({ block })}
        options=${[any, ...Array.from({ length: 18 }, (_, i) => [String(i + 1), String(i + 1)])]} />
      <${Select} label=${t('slabs.item')} value=${filters.item ?? ''} set=${(name) => set({ item: name })}
        options=${[any, ...kItems.map((name) => [name, item(name)])]} />
      <button type="button" class="quiet-button" onClick=${() => { setId(''); go('/slabs'); }}>${t('slabs.reset')}</button>
    </form>
    <p class="quiet hint">${t('slabs.conditions')}</p>
    <${Loaded} ask=${ask}>${(history) => html`
      <div class="panel"><${SlabRows} caption=${t('slabs.caption', { count: history.slabs.length })} slabs=${history.slabs} empty=${t('slabs.none')} /></div>
      ${history.more && limit < kMost && html`<p><button type="button" onClick=${() => set({ limit: Math.min(kMost, limit * 2) }, true)}>
        ${t('slabs.more')}</button></p>`}
      ${history.gaps.map((gap, i) => html`<p key=${i} class="quiet"><${Foreign}
        text=${t('slabs.gap', { key: gap.slab_key, what: gap.what, at: localTime(gap.at), why: gap.why })} /></p>`)}
    `}<//>`;
}

export const reportAddress = (key, language, full) => `${kApi}/slabs/${key}/report.pdf?language=${language}&full=${full ? 1 : 0}`;
