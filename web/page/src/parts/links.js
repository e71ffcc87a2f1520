// SPDX-License-Identifier: Apache-2.0
// Links of the line: one word each, since when, and what to do. The rules are those of slabctl status --watch.
import { html } from '../html.js';
import { duration } from '../figures.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';
import { Table } from './table.js';

/// {name, ok, word (key), state, cure (key or ''), detail (daemon's text)} of every link of slabd.status/1.
export function linksOf(status) {
  const links = status?.links;
  const link = (name, ok, cure, detail) =>
    ({ name, ok, word: `link.${name}.${ok ? 'up' : 'down'}`, state: ok ? 'up' : 'down', cure: ok ? '' : cure, detail: detail ?? '' });
  const source = ['applied', 'commissioning', 'missing'].includes(status?.calibration?.source)
    ? status.calibration.source : 'missing';
  return [
    link('plc', links?.plc?.alive === true, links?.plc?.clients === 0 ? 'cure.plc_client' : 'cure.plc_heartbeat', links?.plc?.trouble),
    link('robot', links?.pose?.ok === true, 'cure.robot', links?.pose?.ok ? links?.pose?.note : links?.pose?.text),
    link('scanner', links?.scanner?.online === true, 'cure.scanner', links?.scanner?.text),
    link('store', links?.store?.ok === true, 'cure.store', links?.store?.text),
    { name: 'calibration', ok: source === 'applied', word: `link.calibration.${source}`, state: source,
      cure: source === 'applied' ? '' : 'cure.calibration', detail: '' },
  ];
}

/// `compact`: what to do is below the state, for a narrow column.
export function LinkTable({ status, since, caption, now_ms, compact = false }) {
  const { t, units } = useWords();
  const advice = (link) => html`${link.cure && html`<span>→ ${t(link.cure)}</span> `}
    ${link.detail && link.detail !== 'no fault' && html`<span class="quiet"><${Foreign} text=${link.detail} /></span>`}`;
  const links = linksOf(status);
  const columns = [
    { head: t('field.link'), row: true, cell: (link) => t(`link.${link.name}`) },
    { head: t('field.state'), cell: (link) => html`<span class=${`link-state ${link.ok ? 'is-ok' : 'is-bad'}`}>
        <span aria-hidden="true">${link.ok ? '✓' : '✗'}</span> ${t(link.word)}</span>
        ${compact && (link.cure || link.detail) ? html`<div class="advice">${advice(link)}</div>` : ''}` },
    { head: t('field.since'), cell: (link) => {
        const { for_ms, atLeast } = since.note(link.name, link.state, now_ms);
        return html`<span class="quiet time">${t(atLeast ? 'link.for_at_least' : 'link.for', { time: duration(for_ms / 1000, units) })}</span>`;
      } },
    !compact && { head: t('field.cure'), cell: advice },
  ].filter(Boolean);
  return html`<${Table} caption=${caption} columns=${columns} rows=${links} id=${(link) => link.name} hideCaption />`;
}
