// SPDX-License-Identifier: Apache-2.0
// One block: its items, its deviation map with a section, its surface in 3-D, and how it was scanned.
import { useMemo, useState } from 'preact/hooks';
import { kOpen_ms, useDocument, whileOpen } from '../api.js';
import { figure, localTime } from '../figures.js';
import { html } from '../html.js';
import { HeatMap, ScaleBar } from '../parts/heat_map.js';
import { beyond, kScales_mm, scaleFor } from '../parts/heat_scale.js';
import { BudgetTable, ItemTable } from '../parts/items.js';
import { Loaded, PageHead, Panel } from '../parts/panel.js';
import { mapOf, section } from '../parts/profile.js';
import { SectionChart } from '../parts/section_chart.js';
import { SurfaceView } from '../parts/surface_view.js';
import { Facts, Table } from '../parts/table.js';
import { Link } from '../router.js';
import { Foreign, visible } from '../text.js';
import { bandVerdict, VerdictMark } from '../verdict.js';
import { useWords } from '../words.js';

const kExaggerations = [1, 2, 5, 10, 20, 50, 100, 200, 500];
/// Heights of the first picture: the scale's ends are a visible part of the block's size.
const startOf = (end_mm) => kExaggerations.findLast((factor) => factor * end_mm <= 60) ?? 1;

/// The block's own items as they are in force: an item of the slab with limits replaces the block's.
export function itemsInForce(slab, block) {
  const own = block.result?.items ?? [];
  const of_block = slab.items.filter((item) => item.stations?.includes(block.station));
  const replacing = (item) =>
    of_block.find((other) => other.id === item.id && other.stations.length === 1 && (other.lower !== null || other.upper !== null));
  return {
    own: own.map((item) => replacing(item) ?? item),
    in_slab: of_block.filter((item) => item.stations.length > 1 || !own.some((other) => other.id === item.id)),
  };
}

export function ScaleChoice({ value, automatic_mm, set }) {
  const { t } = useWords();
  return html`<label class="field"><span>${t('heat.scale')}</span>
    <select value=${String(value)} onChange=${(event) => set(Number(event.target.value))}>
      <option value="0">${t('heat.auto', { scale: automatic_mm })}</option>
      ${kScales_mm.map((scale) => html`<option key=${scale} value=${String(scale)}>${t('heat.plus_minus', { scale })}</option>`)}
    </select></label>`;
}

function Slider({ label, value, text, ...rest }) {
  return html`<label class="field field-slider"><span>${label}: <strong>${text}</strong></span>
    <input type="range" value=${value} aria-valuetext=${text} ...${rest} /></label>`;
}

/// Both stored maps, one at a time: against the model of the block, and of the seat against its own plane.
function Maps({ document, path, station, theme }) {
  const { t } = useWords();
  const maps = useMemo(() => ({ deviation: mapOf(document, 'deviation'), seat: mapOf(document, 'seat') }), [document]);
  const there = Object.keys(maps).filter((which) => maps[which] !== null);
  const [wanted, setWanted] = useState('deviation');
  const which = there.includes(wanted) ? wanted : there[0];
  if (which === undefined) return html`<p class="quiet">${t('block.no_map')}</p>`;
  const choice = html`<label class="field"><span>${t('block.which')}</span>
    <select value=${which} onChange=${(event) => setWanted(event.target.value)}>
      ${there.map((name) => html`<option key=${name} value=${name}>${t(name === 'seat' ? 'block.of_seat' : 'block.of_model')}</option>`)}
    </select></label>`;
  return html`<${OneMap} key=${which} map=${maps[which]} attempt=${document.attempt} choice=${choice} path=${path} station=${station} theme=${theme} />`;
}

function OneMap({ map, attempt, choice, path, station, theme }) {
  const { t } = useWords();
  const automatic_mm = useMemo(() => scaleFor(map.values), [map]);
  const [chosen, setChosen] = useState(0);
  const end_mm = chosen || automatic_mm;
  const [cursor, setCursor] = useState({ column: Math.floor(map.columns / 2), row: Math.floor(map.rows / 2) });
  const [angle, setAngle] = useState(90);
  const [step, setStep] = useState(kExaggerations.indexOf(startOf(automatic_mm)));
  const [open, setOpen] = useState(false);
  const exaggeration = kExaggerations[step];
  const samples = useMemo(() => section(map, cursor.column, cursor.row, angle), [map, cursor, angle]);
  return html`
    <${Panel} title=${t('block.map')}
      aside=${html`<div class="buttons">${choice}<${ScaleChoice} value=${chosen} automatic_mm=${automatic_mm} set=${setChosen} /></div>`}>
      <div class="map-and-section">
        <div><${HeatMap} map=${map} end_mm=${end_mm} cursor=${cursor} setCursor=${setCursor} angle_deg=${angle} theme=${theme}
            label=${t('heat.label', { station })} />
          <${ScaleBar} end_mm=${end_mm} beyond=${beyond(map.values, end_mm)} /></div>
        <div><h3>${t('profile.title')}</h3>
          <${SectionChart} samples=${samples} exaggeration=${exaggeration} />
          <${Slider} label=${t('profile.angle')} text=${t('profile.angle_value', { angle })} value=${angle} min="0" max="175" step="5"
            onInput=${(event) => setAngle(Number(event.target.value))} />
          <${Slider} label=${t('profile.exaggeration')} text=${`× ${exaggeration}`} value=${step} min="0" max=${kExaggerations.length - 1}
            step="1" onInput=${(event) => setStep(Number(event.target.value))} /></div>
      </div>
    <//>
    <${Panel} title=${t('block.surface')} aside=${html`<button type="button" aria-expanded=${String(open)}
        onClick=${() => setOpen(!open)}>${t('surface.open')}</button>`}>
      ${open && html`<${SurfaceView} map=${map} attempt=${attempt} path=${`${path}/cloud`} chosen_mm=${chosen} end_mm=${end_mm}
        exaggeration=${exaggeration} station=${station} theme=${theme} />`}
    <//>`;
}

function Defects({ result }) {
  const { t } = useWords();
  const columns = [
    { head: t('field.kind'), row: true, cell: (finding) => t(`finding.${visible(finding.kind, 20)}`) },
    { head: t('field.where'), cell: (finding) => `${t(`face.${visible(finding.face, 20)}`)}, x ${figure(finding.x_mm, 0)}, s ${figure(finding.s_mm, 0)}` },
    { head: t('finding.size'), number: true, cell: (finding) => `${figure(finding.length_mm, 0)} × ${figure(finding.width_mm, 0)}` },
    { head: t('finding.depth'), number: true, cell: (finding) => figure(finding.depth_mm, 1) },
    { head: t('finding.area'), number: true, cell: (finding) => figure(finding.area_mm2, 0) },
  ];
  const pores = result.pores;
  return html`<${Panel} title=${t('block.defects')}>
    ${pores && pores.largest_mm !== null && html`<p>${t('block.pores')}: ${t('block.pores_text', { count: pores.count,
      largest: figure(pores.largest_mm, 1), deepest: figure(pores.deepest_mm, 1) })}</p>`}
    <${Table} caption=${t('finding.caption')} columns=${columns} rows=${result.findings} empty=${t('app.none')} />
  <//>`;
}

/// Verdict of the block as a band. Before SLAB_END it is provisional, so a pass is not shown as one.
function BlockVerdict({ slab, station, verdict, why }) {
  const { t, reason } = useWords();
  const shown = bandVerdict(verdict, slab.ended);
  return html`<div class=${`slab-verdict v-${shown}`} data-block=${station} data-verdict=${shown}>
    ${!slab.ended && html`<span>· ${t('slab.still_open')}</span>`}
    <${VerdictMark} verdict=${verdict} className=${slab.ended ? 'large' : ''} /> ${why ? html`<span>${reason(why)}</span>` : ''}
    ${slab.emulated && html`<span class="mark">${t('emulation.mark')}</span>`}</div>`;
}

/// Number of the newest measured attempt, which is that of the stored maps; null if there is none.
export const measuredAttempt = (attempts) => attempts.findLast((one) => one.result)?.attempt ?? null;

/// Note that the maps are of an older attempt than the verdict: the newest attempt was not measured.
function OtherAttempt({ map, block, newest }) {
  const { t } = useWords();
  // The two documents are kept for different times, so that one of them may be older.
  if (!block || map.attempt === null || map.attempt === block.attempt || map.attempt !== newest) return null;
  return html`<p class="warning-line"><span aria-hidden="true">! </span>${t('block.other_attempt', { map: map.attempt, attempt: block.attempt })}</p>`;
}

export function Block({ route, theme }) {
  const { t } = useWords();
  const { key, station } = route;
  const path = `/slabs/${key}/blocks/${station}`;
  const ask = useDocument(path, 'slabd.slab/1', { every_ms: whileOpen });
  const slab = ask.document;
  const attempts = slab?.blocks.filter((block) => block.station === station) ?? [];
  const block = attempts.find((one) => one.valid) ?? attempts.at(-1);
  // The server caches maps for 5 s, so that they may be those of the previous attempt when the slab has ended.
  const maps = useDocument(`${path}/map`, 'slabd.block_map/1',
    { every_ms: (map) => (slab?.ended && map.attempt === measuredAttempt(attempts) ? 0 : kOpen_ms) });
  const [budget, setBudget] = useState(false);
  const last = slab?.stations ?? 18;
  const name = slab ? visible(slab.slab_id || slab.slab_no, 64) : key;
  return html`
    <nav class="way" aria-label=${t('page.slab', { name })}>
      <${Link} to=${`/slabs/${key}`}>←${' '}<${Foreign} text=${t('page.slab', { name })} /><//>
      <span class="buttons">
        ${station > 1 && html`<${Link} class="button" to=${`/slabs/${key}/blocks/${station - 1}`}>‹ ${t('page.block', { station: station - 1 })}<//>`}
        ${station < last && html`<${Link} class="button" to=${`/slabs/${key}/blocks/${station + 1}`}>${t('page.block', { station: station + 1 })} ›<//>`}
      </span>
    </nav>
    <${PageHead} title=${t('page.block', { station })} />
    <${Loaded} ask=${ask}>${(slab) => {
      const final = slab.station_verdicts?.find((one) => one.station === station);
      const verdict = final?.verdict ?? block?.final_verdict ?? 'none';
      const why = final?.reason ?? block?.final_reason ?? 0;
      const items = block ? itemsInForce(slab, block) : { own: [], in_slab: [] };
      return html`
        <${BlockVerdict} slab=${slab} station=${station} verdict=${verdict} why=${why} />
        ${!block && html`<p>${t('block.not_scanned')}</p>`}
        ${block?.result && html`
          <${Panel} title=${t('block.items')} aside=${html`<button type="button" aria-pressed=${String(budget)}
              onClick=${() => setBudget(!budget)}>${t('slab.budget')}</button>`}>
            <${ItemTable} caption=${t('block.items')} items=${items.own} />
            ${items.in_slab.length > 0 && html`<h3>${t('block.in_slab')}</h3><${ItemTable} caption=${t('block.in_slab')} items=${items.in_slab} ofSlab />`}
            ${budget && html`<${BudgetTable} items=${[...items.own, ...items.in_slab]} ofSlab />`}
          <//>`}
        ${maps.error?.status === 404 ? html`<p class="quiet">${t('block.no_map')}</p>`
          : html`<${Loaded} ask=${maps}>${(document) => html`<${OtherAttempt} map=${document} block=${block} newest=${measuredAttempt(attempts)} />
            <${Maps} key=${`${key} ${station}`} document=${document} path=${path} station=${station} theme=${theme} />`}<//>`}
        ${block?.result && html`<${Defects} result=${block.result} />`}
        ${block && html`<${Panel} title=${t('block.scan')}><${Facts} facts=${[
          [t('block.attempt'), block.attempt],
          (slab.more_arms ?? []).length > 0 && [t('block.by'),
            t('calibration.arm', { scanner: visible(block.scanner, 16), robot: visible(block.robot, 16) })],
          [t('slab.scanned'), localTime(block.scanned)],
          [t('block.points'), block.points],
          [t('block.spread'), `${figure(block.pose_spread_mm, 4)} mm`],
          [t('slab.settled'), figure((block.settle_ms ?? NaN) / 1000, 2)],
          [t('slab.acquired'), figure((block.acquire_ms ?? NaN) / 1000, 2)],
          block.result && [t('block.registration'), html`<${Foreign} text=${block.result.registration.status} />, ${
            figure(block.result.registration.deviation.mean_mm, 3)} ± ${figure(block.result.registration.deviation.std_mm, 3)} mm`],
          block.scan_path && [t('block.scan'), html`<${Foreign} text=${block.scan_path} />`],
        ]} /><//>`}`;
    }}<//>`;
}
