// SPDX-License-Identifier: Apache-2.0
// A table with a caption. It scrolls inside its frame if it is wider than the screen; the frame can be reached by keyboard.
import { html } from '../html.js';

/// `columns`: {head, cell(row), number?: aligned right, row?: heads its row}. `rows`: anything; `id(row)`: its key.
export function Table({ caption, columns, rows, id = (_, i) => i, rowClass = () => '', hideCaption = false, empty = '', dense = false }) {
  if (rows.length === 0 && empty !== '') return html`<p class="quiet">${empty}</p>`;
  return html`<div class="table-frame" tabindex="0" role="group" aria-label=${caption}>
    <table class=${dense ? 'dense' : ''}>
      <caption class=${hideCaption ? 'for-readers' : ''}>${caption}</caption>
      <thead><tr>
        ${columns.map((column) => html`<th scope="col" class=${column.number ? 'number' : ''}>${column.head}</th>`)}
      </tr></thead>
      <tbody>
        ${rows.map(
          (row, i) => html`<tr key=${id(row, i)} class=${rowClass(row)}>
            ${columns.map((column) =>
              column.row
                ? html`<th scope="row" class=${column.number ? 'number' : ''}>${column.cell(row, i)}</th>`
                : html`<td class=${column.number ? 'number' : ''}>${column.cell(row, i)}</td>`,
            )}
          </tr>`,
        )}
      </tbody>
    </table>
  </div>`;
}

/// Pairs of a name and a value.
export function Facts({ facts }) {
  return html`<dl class="facts">
    ${facts.filter(Boolean).map(([name, value]) => html`<div key=${name}><dt>${name}</dt><dd>${value}</dd></div>`)}
  </dl>`;
}
