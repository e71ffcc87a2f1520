// SPDX-License-Identifier: Apache-2.0
// Rows of slabd.history/1 as a table.
import { html } from '../html.js';
import { localTime } from '../figures.js';
import { Link } from '../router.js';
import { Foreign } from '../text.js';
import { VerdictMark } from '../verdict.js';
import { useWords } from '../words.js';
import { Table } from './table.js';

export function SlabRows({ caption, slabs, short = false, linked = true, empty = '', hideCaption = false }) {
  const { t, reason } = useWords();
  const columns = [
    { head: t('field.slab'), row: true, cell: (slab) => {
        const name = html`<${Foreign} text=${slab.slab_id === '' ? `${slab.slab_no}` : slab.slab_id} max=${64} />`;
        return linked ? html`<${Link} class="row-link slab-link" to=${`/slabs/${slab.key}`}>${name}<//>` : html`<span class="slab-link">${name}</span>`;
      } },
    { head: t('field.verdict'), cell: (slab) => (slab.ended ? html`<${VerdictMark} verdict=${slab.verdict} />`
        : html`<span class="quiet">· ${t('verdict.open')}</span>`) },
    ...(slabs.some((slab) => slab.disposition) ? [{ head: t('slab.disposition'), cell: (slab) => (slab.disposition ? t(`disposition.${slab.disposition}`) : '') }] : []),
    { head: short ? t('field.ended') : t('field.began'),
      cell: (slab) => html`<time class="time">${short ? localTime(slab.ended ?? slab.began, false).slice(5, 16) : localTime(slab.began, false)}</time>` },
    { head: t('field.reason'), cell: (slab) => html`${slab.reason ? html`<span class="reason">${reason(slab.reason)}</span> ` : ''}
        ${slab.emulated && html` <span class="mark">${t('emulation.mark')}</span>`}` },
    !short && { head: t('field.blocks'), number: true, cell: (slab) => `${slab.stations_measured}/${slab.stations}` },
    !short && { head: t('field.type'), number: true, cell: (slab) => slab.slab_type },
    !short && { head: t('field.no'), number: true, cell: (slab) => slab.slab_no },
    !short && { head: t('field.key'), number: true, cell: (slab) => slab.key },
  ].filter(Boolean);
  return html`<${Table} caption=${caption} columns=${columns} rows=${slabs} id=${(slab) => slab.key} empty=${empty}
    hideCaption=${hideCaption} />`;
}
