// SPDX-License-Identifier: Apache-2.0
// Two slabs place by place, their maps of verdicts, and the deviation maps of one block with their difference.
import { useEffect, useMemo, useState } from 'preact/hooks';
import { useDocument } from '../api.js';
import { figure, kNone } from '../figures.js';
import { html } from '../html.js';
import { HeatMap, ScaleBar } from '../parts/heat_map.js';
import { beyond, scaleFor } from '../parts/heat_scale.js';
import { Loaded, PageHead, Panel } from '../parts/panel.js';
import { difference, mapOf } from '../parts/profile.js';
import { blocksOf, SlabMap } from '../parts/slab_map.js';
import { Table } from '../parts/table.js';
import { address, go, Link } from '../router.js';
import { Foreign } from '../text.js';
import { kVerdicts, VerdictMark } from '../verdict.js';
import { useWords } from '../words.js';
import { ScaleChoice } from './block.js';

const kRowsShown = 100;
const isAngle = (item) => item === 'seat_slope' || String(item).startsWith('jaw_angle');

function Differences({ comparison }) {
  const { t, item } = useWords();
  const digits = (row) => (isAngle(row.item) ? 4 : 3);
  const verdict = (value) => (kVerdicts.includes(value) ? html`<${VerdictMark} verdict=${value} />` : kNone);
  const columns = [
    { head: t('field.item'), row: true, cell: (row) => item(row.item ?? '') },
    { head: t('field.block'), number: true, cell: (row) => (row.station === null ? kNone : row.station_to ? `${row.station}-${row.station_to}` : row.station) },
    { head: 'A', number: true, cell: (row) => figure(row.a, digits(row)) },
    { head: 'B', number: true, cell: (row) => figure(row.b, digits(row)) },
    { head: 'B − A', number: true, cell: (row) => html`<strong>${figure(row.difference, digits(row))}</strong>` },
    { head: 'U', number: true, cell: (row) => figure(row.U, digits(row)) },
    { head: 'En', number: true, cell: (row) => html`<span class=${row.en > 1 ? 'verdict v-indeterminate' : ''}>${row.en > 1 ? html`<span aria-hidden="true">! </span>` : ''}${figure(row.en, 2)}</span>` },
    { head: `A: ${t('field.verdict')}`, cell: (row) => verdict(row.verdict_a) },
    { head: `B: ${t('field.verdict')}`, cell: (row) => verdict(row.verdict_b) },
  ];
  const rows = comparison.rows.slice(0, kRowsShown);
  const rest = comparison.rows.length - rows.length;
  return html`<p><${Foreign} text=${comparison.note} /></p>
    <${Table} caption=${t('compare.caption')} columns=${columns} rows=${rows} empty=${t('compare.same')}
      id=${(row) => `${row.item} ${row.station} ${row.station_to}`} />
    ${rest > 0 && html`<p class="quiet">${t('compare.more', { count: rest })}</p>`}`;
}

/// `chosen`: end of the scale, 0: automatic; it stays when another station is chosen.
function ThreeMaps({ a, b, keys, station, chosen, setChosen, theme }) {
  const { t } = useWords();
  const maps = useMemo(() => {
    const [first, second] = [mapOf(a, 'deviation'), mapOf(b, 'deviation')];
    return [first, second, difference(first, second)];
  }, [a, b]);
  const automatic_mm = useMemo(() => scaleFor(maps.slice(0, 2).flatMap((map) => map?.values ?? [])), [maps]);
  const [cursor, setCursor] = useState(null);
  const end_mm = chosen || automatic_mm;
  const titles = [t('compare.map_a', { key: keys[0] }), t('compare.map_b', { key: keys[1] }), t('compare.map_difference')];
  return html`<${ScaleChoice} value=${chosen} automatic_mm=${automatic_mm} set=${setChosen} />
    <div class="three">${maps.map((map, i) => html`<div key=${i}><h3>${titles[i]}</h3>
      ${map === null ? html`<p class="quiet">${t(i === 2 ? 'compare.no_common' : 'block.no_map')}</p>`
        : html`<${HeatMap} map=${map} end_mm=${end_mm} cursor=${cursor} setCursor=${setCursor} theme=${theme}
            label=${`${titles[i]}. ${t('heat.label', { station })}`} />`}</div>`)}</div>
    <${ScaleBar} end_mm=${end_mm} beyond=${beyond(maps[0]?.values ?? [], end_mm) + beyond(maps[1]?.values ?? [], end_mm)} />`;
}

// One station of the two slabs. Its key is the pair and the station, so that no map of the pair before is drawn meanwhile.
function StationMaps({ a, b, station, ...rest }) {
  const path = (key) => `/slabs/${key}/blocks/${station}/map`;
  const first = useDocument(path(a), 'slabd.block_map/1');
  const second = useDocument(path(b), 'slabd.block_map/1');
  return html`<${Loaded} ask=${first}>${(one) => html`<${Loaded} ask=${second}>${(two) =>
    html`<${ThreeMaps} a=${one} b=${two} keys=${[a, b]} station=${station} ...${rest} />`}<//>`}<//>`;
}

function BlockMaps({ a, b, theme }) {
  const { t } = useWords();
  const [station, setStation] = useState(0);
  const [chosen, setChosen] = useState(0);
  return html`<label class="field"><span>${t('compare.block')}</span>
      <select value=${String(station)} onChange=${(event) => setStation(Number(event.target.value))}>
        <option value="0">${t('compare.choose')}</option>
        ${Array.from({ length: 18 }, (_, i) => html`<option key=${i} value=${String(i + 1)}>${i + 1}</option>`)}
      </select></label>
    ${station > 0 && html`<${StationMaps} key=${`${a} ${b} ${station}`} a=${a} b=${b} station=${station}
      chosen=${chosen} setChosen=${setChosen} theme=${theme} />`}`;
}

function SmallMap({ slabKey, name }) {
  const ask = useDocument(`/slabs/${slabKey}/map`, 'slabd.slab_map/1');
  return html`<div><h3>${name}: <${Link} to=${`/slabs/${slabKey}`}>${slabKey}<//></h3>
    <${Loaded} ask=${ask}>${(map) => html`<p><${Foreign} text=${map.slab_id || String(map.slab_no)} max=${64} /> <${VerdictMark} verdict=${map.verdict} /></p>
      <${SlabMap} blocks=${blocksOf(map)} slabKey=${slabKey} small />`}<//></div>`;
}

export function Compare({ route, theme }) {
  const { t, language } = useWords();
  const legal = (name) => (/^[1-9]\d{0,18}$/.test(route.query.get(name) ?? '') ? route.query.get(name) : '');
  const [a, b] = [legal('a'), legal('b')];
  const all = route.query.get('all') === '1';
  const [first, setFirst] = useState(a);
  const [second, setSecond] = useState(b);
  // The browser's back button changes the address.
  useEffect(() => setFirst(a), [a]);
  useEffect(() => setSecond(b), [b]);
  const both = a !== '' && b !== '';
  const ask = useDocument(both ? address('/compare', { a, b, all: all ? 1 : 0, language }) : null, 'slabd.comparison/1');
  const submit = (event) => {
    event.preventDefault();
    go(address('/compare', { a: first.trim(), b: second.trim(), all: all ? 1 : '' }));
  };
  const key = (label, value, set) => html`<label class="field"><span>${label}</span>
    <input type="text" inputmode="numeric" pattern="[1-9][0-9]*" maxlength="19" required value=${value} autocomplete="off"
      onInput=${(event) => set(event.target.value)} /></label>`;
  return html`
    <${PageHead} title=${t('compare.title')} />
    <form class="filters" onSubmit=${submit} aria-label=${t('compare.title')}>
      ${key(t('compare.a'), first, setFirst)} ${key(t('compare.b'), second, setSecond)}
      <label class="field-check"><input type="checkbox" checked=${all}
        onChange=${(event) => go(address('/compare', { a, b, all: event.target.checked ? 1 : '' }), true)} /> <span>${t('compare.all')}</span></label>
      <button type="submit">${t('compare.go')}</button>
    </form>
    ${!both && html`<p class="quiet">${t('compare.hint')}</p>`}
    ${both && html`
      <${Panel} title=${t('compare.maps')}><div class="two"><${SmallMap} key=${`a${a}`} slabKey=${a} name="A" /><${SmallMap} key=${`b${b}`} slabKey=${b} name="B" /></div>
        <${BlockMaps} a=${a} b=${b} theme=${theme} /><//>
      <${Panel} title=${t('compare.differences')}><${Loaded} ask=${ask}>${(comparison) => html`<${Differences} comparison=${comparison} />`}<//><//>`}`;
}
