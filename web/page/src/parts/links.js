// SPDX-License-Identifier: Apache-2.0
// Links of the line: one word each, since when, and what to do. The rules are those of slabctl status --watch.
import { html } from '../html.js';
import { duration } from '../figures.js';
import { Foreign, visible } from '../text.js';
import { useWords } from '../words.js';
import { Table } from './table.js';

/// {robot, scanner, pose, link, calibration, temperature_c} of every robot with its scanner. The ids are empty on a line
/// with one.
export function armsOf(status) {
  const arms = Array.isArray(status?.arms) ? status.arms : [];
  if (arms.length > 1)
    return arms.map((arm) => ({ robot: visible(arm.robot, 16), scanner: visible(arm.scanner, 16), pose: arm.pose, link: arm.scanner_link,
      calibration: arm.calibration, temperature_c: arm.temperature_c }));
  return [{ robot: '', scanner: '', pose: status?.links?.pose, link: status?.links?.scanner, calibration: status?.calibration,
    temperature_c: status?.scanner_temperature_c }];
}

/// {name, part (id of the robot or scanner, or ''), ok, word (key), state, cure (key or ''), detail (daemon's text)} of
/// every link of slabd.status/1.
export function linksOf(status) {
  const links = status?.links;
  const arms = armsOf(status);
  const link = (name, ok, cure, detail, part = '') =>
    ({ name, part, ok, word: `link.${name}.${ok ? 'up' : 'down'}`, state: ok ? 'up' : 'down', cure: ok ? '' : cure, detail: detail ?? '' });
  const calibration = ({ scanner, calibration: inForce }) => {
    const source = ['applied', 'commissioning', 'missing'].includes(inForce?.source) ? inForce.source : 'missing';
    return { name: 'calibration', part: scanner, ok: source === 'applied', word: `link.calibration.${source}`, state: source,
      cure: source === 'applied' ? '' : 'cure.calibration', detail: '' };
  };
  return [
    link('plc', links?.plc?.alive === true, links?.plc?.clients === 0 ? 'cure.plc_client' : 'cure.plc_heartbeat', links?.plc?.trouble),
    ...arms.map(({ robot, pose }) => link('robot', pose?.ok === true, 'cure.robot', pose?.ok ? pose?.note : pose?.text, robot)),
    ...arms.map(({ scanner, link: delivery }) => link('scanner', delivery?.online === true, 'cure.scanner', delivery?.text, scanner)),
    link('store', links?.store?.ok === true, 'cure.store', links?.store?.text),
    ...arms.map(calibration),
    arms.length > 1 && link('tie', status.tie != null && !status.tie.trouble, 'cure.tie', status.tie?.trouble),
  ].filter(Boolean);
}

/// The link's name, with the id of its robot or scanner on a line with several.
export const nameOfLink = (t, link) => (link.part ? `${t(`link.${link.name}`)} ${link.part}` : t(`link.${link.name}`));

/// `compact`: what to do is below the state, for a narrow column.
export function LinkTable({ status, since, caption, now_ms, compact = false }) {
  const { t, units } = useWords();
  const advice = (link) => html`${link.cure && html`<span>→ ${t(link.cure)}</span> `}
    ${link.detail && link.detail !== 'no fault' && html`<span class="quiet"><${Foreign} text=${link.detail} /></span>`}`;
  const links = linksOf(status);
  const columns = [
    { head: t('field.link'), row: true, cell: (link) => nameOfLink(t, link) },
    { head: t('field.state'), cell: (link) => html`<span class=${`link-state ${link.ok ? 'is-ok' : 'is-bad'}`}>
        <span aria-hidden="true">${link.ok ? '✓' : '✗'}</span> ${t(link.word)}</span>
        ${compact && (link.cure || link.detail) ? html`<div class="advice">${advice(link)}</div>` : ''}` },
    { head: t('field.since'), cell: (link) => {
        const { for_ms, atLeast } = since.note(`${link.name} ${link.part}`, link.state, now_ms);
        return html`<span class="quiet time">${t(atLeast ? 'link.for_at_least' : 'link.for', { time: duration(for_ms / 1000, units) })}</span>`;
      } },
    !compact && { head: t('field.cure'), cell: advice },
  ].filter(Boolean);
  return html`<${Table} caption=${caption} columns=${columns} rows=${links} id=${(link) => `${link.name} ${link.part}`} hideCaption />`;
}
