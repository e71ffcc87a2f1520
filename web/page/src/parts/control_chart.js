// SPDX-License-Identifier: Apache-2.0
// The control chart of one characteristic, drawn by uPlot. Its colours are the page's tokens. Without limits of control the
// chart is preliminary and grey.
import { useEffect, useRef, useState } from 'preact/hooks';
import uPlot from 'uplot';
import { decimalsOf, figure } from '../figures.js';
import { html } from '../html.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';
import { columnsOf, limitsOf, rangeOf } from './chart_data.js';

const kHeight = 340;

const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function drawLines(plot, trend) {
  const { ctx, bbox } = plot;
  const { lower, upper } = limitsOf(trend);
  const lines = [
    [lower, '--chart-limit', [], 2],
    [upper, '--chart-limit', [], 2],
    [trend.chart.lower_control, '--chart-control', [8, 6], 1.5],
    [trend.chart.upper_control, '--chart-control', [8, 6], 1.5],
    [trend.chart.mean, '--chart-control', [2, 4], 1.5],
  ];
  ctx.save();
  for (const [value, colour, dash, width] of lines) {
    if (typeof value !== 'number') continue;
    const y = plot.valToPos(value, 'y', true);
    if (y < bbox.top || y > bbox.top + bbox.height) continue;
    ctx.strokeStyle = token(colour);
    ctx.lineWidth = width * devicePixelRatio;
    ctx.setLineDash(dash.map((part) => part * devicePixelRatio));
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
  }
  ctx.restore();
}

/// Crosses for values outside, squares for signals: a shape, not only a colour.
function marks(shape) {
  return (plot, seriesIndex, first, last) => {
    const { ctx } = plot;
    const size = 5 * devicePixelRatio;
    ctx.save();
    ctx.strokeStyle = token('--chart-mark');
    ctx.lineWidth = 2 * devicePixelRatio;
    for (let i = first; i <= last; ++i) {
      const value = plot.data[seriesIndex][i];
      if (value === null || value === undefined) continue;
      const x = plot.valToPos(plot.data[0][i], 'x', true);
      const y = plot.valToPos(value, 'y', true);
      ctx.beginPath();
      if (shape === 'cross') {
        ctx.moveTo(x - size, y - size);
        ctx.lineTo(x + size, y + size);
        ctx.moveTo(x + size, y - size);
        ctx.lineTo(x - size, y + size);
      } else ctx.rect(x - size, y - size, 2 * size, 2 * size);
      ctx.stroke();
    }
    ctx.restore();
    return null;
  };
}

export function ControlChart({ trend, theme, label }) {
  const { t, language } = useWords();
  const host = useRef(null);
  const plot = useRef(null);
  const [at, setAt] = useState(null);
  useEffect(() => {
    const digits = decimalsOf(trend.unit);
    const font = `14px ${token('--font')}`;
    const axis = { stroke: token('--ink-quiet'), grid: { stroke: token('--chart-grid'), width: 1 }, ticks: { show: false }, font };
    const many = trend.block === null;
    plot.current = new uPlot(
      {
        width: Math.max(280, host.current.clientWidth),
        height: kHeight,
        legend: { show: false },
        cursor: { y: false, points: { show: true }, drag: { x: true, y: false, uni: 8 } },
        scales: { x: { time: false }, y: { range: () => rangeOf(trend) } },
        axes: [
          { ...axis, incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 5000, 10000] },
          { ...axis, size: 92, values: (_, ticks) => ticks.map((tick) => figure(tick, digits)) },
        ],
        bands: many ? [{ series: [3, 2], fill: token('--chart-band') }] : [],
        series: [
          {},
          { stroke: token('--chart-line'), width: 1.5, points: { show: true, size: 6, fill: token('--chart-line') }, spanGaps: false },
          { show: many, width: 0, points: { show: false } },
          { show: many, width: 0, points: { show: false } },
          { paths: marks('square'), points: { show: false } },
          { paths: marks('cross'), points: { show: false } },
        ],
        hooks: { draw: [(u) => drawLines(u, trend)], setCursor: [(u) => setAt(u.cursor.idx ?? null)] },
      },
      columnsOf(trend),
      host.current,
    );
    const watch = new ResizeObserver(() => plot.current?.setSize({ width: Math.max(280, host.current.clientWidth), height: kHeight }));
    watch.observe(host.current);
    return () => {
      watch.disconnect();
      plot.current.destroy();
      plot.current = null;
    };
  }, [trend, theme, language]);

  const count = trend.series.length;
  const pressed = (event) => {
    const move = { ArrowLeft: -1, ArrowRight: 1, Home: -count, End: count }[event.key];
    if (move === undefined || plot.current === null) return;
    event.preventDefault();
    const next = Math.min(count - 1, Math.max(0, (at ?? count) + move));
    const x = plot.current.valToPos(next + 1, 'x');
    plot.current.setCursor({ left: x, top: kHeight / 2 });
    setAt(next);
  };
  const point = at === null ? null : trend.series[at];
  const digits = decimalsOf(trend.unit);
  return html`<figure class=${`chart${trend.preliminary ? ' chart-preliminary' : ''}`}>
    <div class="chart-frame" ref=${host} tabindex="0" role="application" aria-label=${label} onKeyDown=${pressed}></div>
    <figcaption>
      <output class="chart-value" aria-live="polite">${point
        ? html`<${Foreign} text=${point.slab_id || String(point.key)} max=${64} />: ${figure(point.value, digits)} ${trend.unit}${
            trend.block === null && point.lowest !== null ? ` (${figure(point.lowest, digits)} .. ${figure(point.highest, digits)})` : ''}${
            point.signal !== 'none' ? `, ${t('trends.signal')}` : ''}`
        : html`<span class="quiet">${t('trends.hint')}</span>`}</output>
      <ul class="chart-legend">
        <li><i class="key key-line"></i>${t('trends.value')}</li>
        ${trend.block === null && html`<li><i class="key key-band"></i>${t('trends.range')}</li>`}
        <li><i class="key key-control"></i>${t('trends.control')}</li>
        ${!trend.limits_differ && html`<li><i class="key key-limit"></i>${t('trends.limits')}</li>`}
        <li><span aria-hidden="true">□</span> ${t('trends.signal')}</li>
        <li><span aria-hidden="true">✕</span> ${t('trends.outside')}</li>
      </ul>
      <button type="button" class="quiet-button" onClick=${() => plot.current?.setScale('x', { min: 1, max: Math.max(2, count) })}>
        ${t('trends.reset_zoom')}</button>
    </figcaption>
  </figure>`;
}
