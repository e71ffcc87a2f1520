// SPDX-License-Identifier: Apache-2.0
// A height map on a canvas: x (along the rail) to the right, y or s (across the rail) upwards. The value under the pointer
// or the keyboard's cursor is read out below it.
import { useEffect, useRef } from 'preact/hooks';
import { figure } from '../figures.js';
import { html } from '../html.js';
import { useWords } from '../words.js';
import { colourOf, heightColour } from './heat_scale.js';
import { cell, centre, section } from './profile.js';

/// Screen pixels of a cell; the canvas is scaled to its place by CSS without smoothing.
const kPixels = 4;

function drawCells(context, map, end_mm, ink) {
  const image = context.createImageData(map.columns * kPixels, map.rows * kPixels);
  const width = image.width;
  for (let row = 0; row < map.rows; ++row) {
    for (let column = 0; column < map.columns; ++column) {
      const value = cell(map, column, row);
      const colour = value === null ? null : heightColour(value, end_mm);
      for (let y = 0; y < kPixels; ++y) {
        const py = (map.rows - 1 - row) * kPixels + y;
        for (let x = 0; x < kPixels; ++x) {
          const px = column * kPixels + x;
          const at = 4 * (py * width + px);
          // Nothing was seen: a diagonal hatching.
          const line = colour === null && (px + py) % 8 === 0;
          const [r, g, b] = colour ?? ink;
          image.data[at] = r;
          image.data[at + 1] = g;
          image.data[at + 2] = b;
          image.data[at + 3] = colour !== null ? 255 : line ? 110 : 0;
        }
      }
    }
  }
  context.putImageData(image, 0, 0);
}

function drawSection(context, map, cursor, angle_deg) {
  const samples = section(map, cursor.column, cursor.row, angle_deg);
  if (samples.length < 2) return;
  const place = (sample) => [(sample.column + 0.5) * kPixels, (map.rows - sample.row - 0.5) * kPixels];
  for (const [width, colour] of [[4, '#000'], [1.5, '#fff']]) {
    context.lineWidth = width;
    context.strokeStyle = colour;
    context.beginPath();
    context.moveTo(...place(samples[0]));
    context.lineTo(...place(samples.at(-1)));
    context.stroke();
    context.beginPath();
    context.arc((cursor.column + 0.5) * kPixels, (map.rows - cursor.row - 0.5) * kPixels, 7, 0, 2 * Math.PI);
    context.stroke();
  }
}

/// `cursor`: {column, row}; `setCursor`: called with the pointer or the arrow keys. `angle_deg`: draws the section's line.
export function HeatMap({ map, end_mm, cursor, setCursor, angle_deg = null, label, theme }) {
  const { t } = useWords();
  const canvas = useRef(null);
  const cells = useRef(null);
  useEffect(() => {
    // The cells are drawn once; the cursor moves over a copy of them.
    const buffer = document.createElement('canvas');
    buffer.width = map.columns * kPixels;
    buffer.height = map.rows * kPixels;
    const ink = theme === 'light' ? [60, 66, 72] : [200, 205, 210];
    drawCells(buffer.getContext('2d'), map, end_mm, ink);
    cells.current = buffer;
  }, [map, end_mm, theme]);
  useEffect(() => {
    const context = canvas.current.getContext('2d');
    context.clearRect(0, 0, canvas.current.width, canvas.current.height);
    context.drawImage(cells.current, 0, 0);
    if (cursor) drawSection(context, map, cursor, angle_deg ?? 0);
  }, [map, end_mm, cursor?.column, cursor?.row, angle_deg, theme]);

  const at = cursor ? centre(map, cursor.column, cursor.row) : null;
  const value = cursor ? cell(map, cursor.column, cursor.row) : null;
  const read = !cursor ? t('heat.hint')
    : t(value === null ? 'heat.no_value' : 'heat.value', { x: figure(at[0], 1), across: map.across, s: figure(at[1], 1), value: figure(value, 3) });
  const clamp = (column, row) => setCursor({
    column: Math.min(map.columns - 1, Math.max(0, column)),
    row: Math.min(map.rows - 1, Math.max(0, row)),
  });
  const pointed = (event) => {
    if (event.type === 'pointermove' && event.pointerType !== 'mouse' && event.buttons === 0) return;
    const box = event.currentTarget.getBoundingClientRect();
    clamp(Math.floor(((event.clientX - box.left) / box.width) * map.columns),
      map.rows - 1 - Math.floor(((event.clientY - box.top) / box.height) * map.rows));
  };
  const pressed = (event) => {
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] };
    const move = moves[event.key];
    if (!move) return;
    event.preventDefault();
    const step = event.shiftKey ? 10 : 1;
    const from = cursor ?? { column: Math.floor(map.columns / 2), row: Math.floor(map.rows / 2) };
    clamp(from.column + step * move[0], from.row + step * move[1]);
  };
  return html`<figure class="heat">
    <div class="heat-frame" tabindex="0" role="application" aria-label=${label} onKeyDown=${pressed}>
      <canvas ref=${canvas} width=${map.columns * kPixels} height=${map.rows * kPixels} aria-hidden="true"
        onPointerMove=${pointed} onPointerDown=${pointed}></canvas>
    </div>
    <figcaption><output class="heat-value" aria-live="polite">${read}</output></figcaption>
  </figure>`;
}

/// The scale as a bar with its ends, its middle, and what is beyond it. `note`: the text below it, instead of a map's.
export function ScaleBar({ end_mm, beyond, note = null }) {
  const { t } = useWords();
  const canvas = useRef(null);
  useEffect(() => {
    const context = canvas.current.getContext('2d');
    for (let x = 0; x < 256; ++x) {
      const [r, g, b] = colourOf((x + 0.5) / 256);
      context.fillStyle = `rgb(${r} ${g} ${b})`;
      context.fillRect(x, 0, 1, 1);
    }
  }, []);
  const digits = end_mm < 0.1 ? 3 : end_mm < 1 ? 2 : 1;
  const tick = (value) => (value > 0 ? '+' : '') + figure(value, value === 0 ? 0 : digits + (Math.abs(value) === end_mm ? 0 : 1));
  return html`<div class="scale">
    <canvas ref=${canvas} width="256" height="1" aria-hidden="true"></canvas>
    <div class="scale-ticks" aria-hidden="true">${[-1, -0.5, 0, 0.5, 1].map((share) => html`<span key=${share}>${tick(share * end_mm)}</span>`)}</div>
    <p class="quiet">${note !== null ? note : html`${t('heat.scale_note', { low: figure(-end_mm, digits), high: `+${figure(end_mm, digits)}` })}; ${t('heat.missing')}${
      beyond > 0 ? `; ${t('heat.beyond', { count: beyond })}` : ''}`}</p>
  </div>`;
}
