// SPDX-License-Identifier: Apache-2.0
// Drafts of recipes from CAD models: the list, and one draft with its picture, so that a person sees a mistaken face.
import { useState } from 'preact/hooks';
import { kApi, useDocument } from '../api.js';
import { localTime } from '../figures.js';
import { html } from '../html.js';
import { Loaded, PageHead, Panel } from '../parts/panel.js';
import { Facts, Table } from '../parts/table.js';
import { Link } from '../router.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';

/// Digits for comparison with a drawing: the model's own rounding errors are below them.
const digits = (value) => String(Number(value.toPrecision(10)));

function List({ document }) {
  const { t } = useWords();
  return html`
    <${Table} caption=${t('drafts.caption')} rows=${document.drafts} empty=${t('drafts.none')} id=${(one) => one.name} columns=${[
      { head: t('drafts.name'), row: true, cell: (one) => html`<${Link} to=${`/drafts/${one.name}`} class="row-link"><${Foreign} text=${one.name} /><//>` },
      { head: t('drafts.written'), cell: (one) => html`<time class="time">${localTime(new Date(one.written_utime_us / 1000).toISOString())}</time>` },
      { head: t('drafts.file'), cell: (one) => html`<${Foreign} text=${one.file} />` },
      { head: t('drafts.blocks'), number: true, cell: (one) => one.blocks },
      { head: t('drafts.found'), number: true, cell: (one) => one.found },
      { head: t('drafts.not_found'), number: true, cell: (one) => (one.not_found === 0 ? 0 : html`<strong>${one.not_found}</strong>`) },
    ]} />
    ${document.passed_over.length > 0 && html`<${Panel} title=${t('drafts.passed_over')}><ul>
      ${document.passed_over.map((one) => html`<li key=${one.file}><${Foreign} text=${`${one.file}: ${one.why}`} /></li>`)}</ul><//>`}`;
}

function Picture({ name }) {
  const { t } = useWords();
  const [missing, setMissing] = useState(false);
  const address = `${kApi}/drafts/${encodeURIComponent(name)}/picture.png`;
  if (missing) return html`<p class="quiet">${t('drafts.no_picture')}</p>`;
  return html`<p class="quiet">${t('drafts.picture_text')}</p>
    <a href=${address}><img class="draft-picture" src=${address} alt=${t('drafts.picture_of', { name })} onError=${() => setMissing(true)} /></a>`;
}

function One({ name, draft }) {
  const { t } = useWords();
  return html`
    <${Facts} facts=${[
      [t('drafts.file'), html`<${Foreign} text=${draft.file} />`],
      ['SHA-256', html`<${Foreign} text=${draft.sha256} />`],
      [t('drafts.blocks'), draft.blocks],
      [t('drafts.reference'), `${digits(draft.reference_height_mm)} mm`],
    ]} />
    ${draft.remarks.length > 0 && html`<${Panel} title=${t('drafts.look_at')}><ul>
      ${draft.remarks.map((text, i) => html`<li key=${i}><${Foreign} text=${text} /></li>`)}</ul><//>`}
    <${Panel} title=${t('drafts.not_found')}><${Table} caption=${t('drafts.not_found_caption')} rows=${draft.not_found} empty=${t('drafts.all_found')} id=${(one) => one.key} columns=${[
      { head: t('drafts.key'), row: true, cell: (one) => html`<${Foreign} text=${one.key} />` },
      { head: t('drafts.why'), cell: (one) => html`<${Foreign} text=${one.why} />` },
    ]} /><//>
    <${Panel} title=${t('drafts.picture')}><${Picture} name=${name} /><//>
    <${Panel} title=${t('drafts.found')}><${Table} caption=${t('drafts.found_caption', { name })} rows=${draft.found} id=${(one) => one.key} columns=${[
      { head: t('drafts.key'), row: true, cell: (one) => html`<${Foreign} text=${one.key} />` },
      { head: t('field.value'), number: true, cell: (one) => digits(one.value) },
      { head: t('drafts.from'), cell: (one) => html`<${Foreign} text=${one.note} />` },
      { head: t('drafts.faces'), cell: (one) => one.faces.slice(0, 8).join(', ') + (one.faces.length > 8 ? ' …' : '') },
    ]} /><//>`;
}

function OneDraft({ name }) {
  const ask = useDocument(`/drafts/${encodeURIComponent(name)}`, 'slabd.cad_draft/1');
  return html`<${Loaded} ask=${ask}>${(draft) => html`<${One} name=${name} draft=${draft} />`}<//>`;
}

function AllDrafts() {
  const ask = useDocument('/drafts', 'slabd.recipe_drafts/1');
  return html`<${Loaded} ask=${ask}>${(document) => html`<${List} document=${document} />`}<//>`;
}

export function Drafts({ route }) {
  const { t } = useWords();
  const name = route.draft;
  return html`
    <${PageHead} title=${name ? `${t('drafts.name')} ${name}` : t('drafts.title')}>
      ${name && html`<${Link} to="/drafts">${t('drafts.all')}<//>`}
    <//>
    <p class="quiet">${t('drafts.text')}</p>
    ${name ? html`<${OneDraft} key=${name} name=${name} />` : html`<${AllDrafts} />`}`;
}
