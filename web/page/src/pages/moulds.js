// SPDX-License-Identifier: Apache-2.0
// Moulds: which of them deviate, where, and whether they drift; and what all of them share, which is the line's.
import { useDocument } from '../api.js';
import { figure, kNone, localTime } from '../figures.js';
import { html } from '../html.js';
import { Loaded, PageHead, Panel } from '../parts/panel.js';
import { Table } from '../parts/table.js';
import { Link } from '../router.js';
import { useWords } from '../words.js';

const kRowsShown = 60;
const digits = (effect) => (effect.unit === 'deg' ? 4 : 3);
const place = (effect) => (effect.station === null ? kNone : effect.station_to ? `${effect.station}-${effect.station_to}` : effect.station);
/// Standard errors between the effect and zero.
const strength = (effect) => Math.abs(effect.bias) / effect.u;

/// Proven effects, the clearest first.
export function signalsOf(effects, signal) {
  return effects.filter((effect) => effect.signal === signal || (signal === 'mould' && effect.drifts))
    .sort((a, b) => strength(b) - strength(a));
}

function effectColumns(t, item, withDrift) {
  const drift = (effect) => (effect.drifts ? `${figure(effect.drift_per_100, digits(effect))} ± ${figure(2 * effect.drift_per_100_u, digits(effect))}` : kNone);
  const until = (effect) => (effect.slabs_to_limit === null ? kNone : `${figure(effect.slabs_to_limit, 0)} ± ${figure(2 * effect.slabs_to_limit_u, 0)}`);
  return [
    { head: t('field.item'), row: true, cell: (effect) => item(effect.item) },
    { head: t('field.block'), number: true, cell: place },
    { head: t('field.deviation'), number: true, cell: (effect) => html`<strong>${figure(effect.bias, digits(effect))}</strong> ${effect.unit}` },
    { head: 'U', number: true, cell: (effect) => figure(effect.U, digits(effect)) },
    { head: 'n', number: true, cell: (effect) => effect.n },
    ...(withDrift ? [
      { head: t('moulds.now'), number: true, cell: (effect) => figure(effect.ewma, digits(effect)) },
      { head: t('moulds.drift'), number: true, cell: drift },
      { head: t('moulds.until'), number: true, cell: until },
    ] : []),
  ];
}

function MouldList({ moulds, chosen }) {
  const { t } = useWords();
  const columns = [
    { head: t('field.mould'), row: true, cell: (one) => html`<${Link} to=${`/moulds?mould=${one.mould}`} aria-current=${one.mould === chosen ? 'true' : undefined}>${one.mould}<//>` },
    { head: t('moulds.epoch'), number: true, cell: (one) => `${one.epoch}${one.current ? '' : ` (${t('moulds.past')})`}` },
    { head: t('field.type'), number: true, cell: (one) => one.slab_type ?? kNone },
    { head: t('moulds.slabs'), number: true, cell: (one) => one.slabs },
    { head: t('moulds.last'), cell: (one) => (one.last_utime ? html`<time class="time">${localTime(one.last_utime)}</time>` : kNone) },
    { head: t('moulds.signals'), number: true, cell: (one) => {
      const count = signalsOf(one.effects, 'mould').length;
      return count === 0 ? (one.slabs < 5 ? t('moulds.few') : 0) : html`<strong class="verdict v-indeterminate"><span aria-hidden="true">! </span>${count}</strong>`;
    } },
  ];
  return html`<${Table} caption=${t('moulds.caption')} columns=${columns} rows=${moulds} empty=${t('moulds.none')}
    id=${(one) => `${one.mould} ${one.epoch} ${one.slab_type}`} />`;
}

function Effects({ moulds, chosen }) {
  const { t, item, language } = useWords();
  const rows = moulds.filter((one) => one.mould === chosen && one.current).flatMap((one) => signalsOf(one.effects, 'mould'));
  return html`<p><a href=${`/api/v1/moulds/${chosen}/sheet.pdf?language=${language}`}>${t('moulds.sheet')}</a></p>
    <${Table} caption=${t('moulds.effects_caption', { mould: chosen })} columns=${effectColumns(t, item, true)} rows=${rows.slice(0, kRowsShown)}
      empty=${t('moulds.no_effect')} id=${(effect) => `${effect.item} ${effect.station} ${effect.station_to}`} />`;
}

export function Moulds({ route }) {
  const { t, item } = useWords();
  const ask = useDocument('/moulds', 'slabd.moulds/1');
  return html`
    <${PageHead} title=${t('moulds.title')} />
    <p class="quiet">${t('moulds.about')}</p>
    <${Loaded} ask=${ask}>${(document) => {
      const chosen = Number(route.query.get('mould') ?? 0);
      const line = signalsOf(document.line_effects, 'line');
      return html`
        <${Panel} title=${t('moulds.list')}><${MouldList} moulds=${document.moulds} chosen=${chosen} />
          ${document.unknown_mould_slabs > 0 && html`<p class="quiet">${t('moulds.unknown', { count: document.unknown_mould_slabs })}</p>`}<//>
        ${chosen > 0 && html`<${Panel} title=${t('moulds.effects', { mould: chosen })}><${Effects} moulds=${document.moulds} chosen=${chosen} /><//>`}
        <${Panel} title=${t('moulds.line')}><${Table} caption=${t('moulds.line_caption')} columns=${effectColumns(t, item, false)}
          rows=${line.slice(0, kRowsShown)} empty=${t('moulds.no_line')}
          id=${(effect) => `${effect.slab_type} ${effect.item} ${effect.station} ${effect.station_to}`} /><//>`;
    }}<//>`;
}
