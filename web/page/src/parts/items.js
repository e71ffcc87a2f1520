// SPDX-License-Identifier: Apache-2.0
// Tables of items, with the digits and texts of slabctl show.
import { html } from '../html.js';
import { deviationFigure, figure, kNone, limitsFigure, nominalFigure, uncertaintyFigure, valueFigure } from '../figures.js';
import { VerdictMark } from '../verdict.js';
import { useWords } from '../words.js';
import { Place } from './place.js';
import { Table } from './table.js';

/// The tie of two robots is shown if an item depends on it.
const kParts = ['fit', 'noise', 'scanner', 'registration', 'calibration', 'robot', 'reference', 'thermal', 'gauge', 'tie'];

/// True if the item has neither limit: it is shown for information.
const isInformation = (item) => item.lower === null && item.upper === null;

export function stationsText(item) {
  return (item.stations ?? []).join('-');
}

export function ItemTable({ caption, items, ofSlab = false, empty = '' }) {
  const { t, item: name } = useWords();
  const columns = [
    { head: t('field.item'), row: true, cell: (item) => html`${name(item.id)} <span class="unit">[${item.unit}]</span>` },
    ofSlab && { head: t('field.block'), number: true, cell: stationsText },
    { head: t('field.nominal'), number: true, cell: nominalFigure },
    { head: t('field.limits'), number: true, cell: (item) => (isInformation(item) ? t('item.information') : limitsFigure(item)) },
    { head: t('field.measured'), number: true, cell: (item) => html`<strong>${valueFigure(item)}</strong>` },
    { head: t('field.deviation'), number: true, cell: deviationFigure },
    { head: t('field.u'), number: true, cell: uncertaintyFigure },
    { head: t('field.place'), cell: (item) => html`<${Place} item=${item} />` },
    { head: t('field.verdict'), cell: (item) => html`<${VerdictMark} verdict=${item.verdict} />` },
  ].filter(Boolean);
  return html`<${Table} caption=${caption} columns=${columns} rows=${items} hideCaption empty=${empty}
    id=${(item) => `${item.id} ${stationsText(item)}`} />`;
}

/// Parts of U, one decimal more than U.
export function BudgetTable({ items, ofSlab = false }) {
  const { t, item: name } = useWords();
  const known = items.filter((item) => item.budget !== null && item.budget !== undefined);
  const part = (item, which) => (item.budget[which] ? figure(item.budget[which], 5) : kNone);
  const columns = [
    { head: t('field.item'), row: true, cell: (item) => html`${name(item.id)} <span class="unit">[${item.unit}]</span>` },
    ofSlab && { head: t('field.block'), number: true, cell: stationsText },
    { head: t('field.u'), number: true, cell: uncertaintyFigure },
    ...kParts.filter((which) => which !== 'tie' || known.some((one) => one.budget.tie)).map((which) => ({ head: t(`budget.${which}`), number: true, cell: (item) => part(item, which) })),
  ].filter(Boolean);
  return html`<${Table} caption=${t('slab.budget_caption')} columns=${columns} rows=${known} empty=${t('app.none')}
    id=${(item) => `${item.id} ${stationsText(item)}`} />`;
}
