// SPDX-License-Identifier: Apache-2.0
// The surface in 3-D: the stored map, or the points of the scan while its file is kept. Its program (three.js) is loaded
// when the view is opened, the points when they are chosen.
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { kOpen_ms, useDocument } from '../api.js';
import { figure } from '../figures.js';
import { html } from '../html.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';
import { cloudOf, heightRange } from './cloud.js';
import { ScaleBar } from './heat_map.js';
import { beyond, scaleFor } from './heat_scale.js';
import { Trouble } from './panel.js';

const kProgram = '/assets/three.js';

/// Colours and number of the points, or why they are not there.
function ScanNote({ ask, cloud, low, high }) {
  const { t } = useWords();
  if (ask.error?.status === 404)
    return html`<p role="alert">${t('surface.scan_gone')} <span class="quiet"><${Foreign} text=${ask.error.message} /></span></p>`;
  if (ask.error) return html`<${Trouble} error=${ask.error} again=${ask.again} />`;
  if (!ask.document) return html`<p class="quiet" aria-busy="true">${t('app.loading')} …</p>`;
  if (cloud === null) return html`<p role="alert">${t('error.unusable')}</p>`;
  const points = t('surface.points', { count: cloud.count, all: cloud.read });
  if (!cloud.measured) return html`<p class="quiet">${t('surface.by_height', { low, high })}; ${points}</p>`;
  const digits = high < 0.1 ? 3 : high < 1 ? 2 : 1;
  return html`<${ScaleBar} end_mm=${high} note=${`${t('surface.by_deviation', { low: figure(low, digits), high: `+${figure(high, digits)}`,
    beyond: beyond(cloud.values, high) })}; ${points}`} />`;
}

/// `chosen_mm`: end of the scale, 0: automatic. `end_mm`: that of the map. `path`: where the scan's points are.
/// `attempt`: that of the map. The server caches points for 5 s, so its first answer may be those of the previous attempt.
export function SurfaceView({ map, attempt, path, chosen_mm, end_mm, exaggeration, station, theme }) {
  const { t } = useWords();
  const host = useRef(null);
  const view = useRef(null);
  const [trouble, setTrouble] = useState('');
  const [ready, setReady] = useState(false);
  const [what, setWhat] = useState('map');
  const [asked, setAsked] = useState(false);
  const ask = useDocument(asked ? path : null, 'slabd.block_cloud/1',
    { mark: String(attempt), every_ms: (cloud) => (cloud.attempt === attempt ? 0 : kOpen_ms) });
  const cloud = useMemo(() => (ask.document === null ? null : cloudOf(ask.document)), [ask.document]);
  const [low, high] = useMemo(() => {
    if (cloud === null) return [0, 1];
    if (!cloud.measured) return heightRange(cloud.values);
    const scale_mm = chosen_mm || scaleFor(cloud.values.filter((value) => !Number.isNaN(value)));
    return [-scale_mm, scale_mm];
  }, [cloud, chosen_mm]);
  const shown = what === 'map' ? 'map' : cloud !== null ? 'scan' : 'nothing';
  useEffect(() => {
    let gone = false;
    import(kProgram)
      .then(({ createSurface }) => {
        if (gone) return;
        view.current = createSurface(host.current);
        if (view.current === null) setTrouble(t('surface.no_webgl'));
        else setReady(true);
      })
      .catch(() => !gone && setTrouble(t('error.unreachable')));
    return () => {
      gone = true;
      view.current?.dispose();
      view.current = null;
    };
  }, []);
  useEffect(() => {
    if (!ready) return;
    if (shown === 'map') view.current?.show(map, end_mm);
    else if (shown === 'scan') view.current?.show_cloud(cloud, low, high);
    else view.current?.clear();
  }, [ready, shown, map, end_mm, cloud, low, high]);
  useEffect(() => {
    if (ready) view.current?.look(exaggeration, theme);
  }, [ready, shown, map, end_mm, cloud, low, high, exaggeration, theme]);
  const pressed = (event) => {
    if (view.current?.key(event.key)) event.preventDefault();
  };
  const choose = (one) => {
    setWhat(one);
    if (one === 'scan') setAsked(true);
  };
  const choice = (one, text) => html`<button type="button" aria-pressed=${String(what === one)} onClick=${() => choose(one)}>${text}</button>`;
  if (trouble) return html`<p role="alert">${trouble}</p>`;
  return html`<div class="surface stack">
    <div class="buttons" role="group" aria-label=${t('surface.what')}>
      ${choice('map', t('surface.map'))}${choice('scan', t('surface.scan'))}</div>
    <div class="surface-frame" ref=${host} tabindex="0" role="application" onKeyDown=${pressed} data-ready=${String(ready)} data-shown=${shown}
      aria-label=${shown === 'map' ? t('surface.label', { station, factor: exaggeration })
        : t('surface.scan_label', { station, factor: cloud?.measured ? exaggeration : 1 })}></div>
    ${what === 'scan' && html`<${ScanNote} ask=${ask} cloud=${cloud} low=${low} high=${high} />`}
    <p class="quiet">${t('surface.hint')} <button type="button" onClick=${() => view.current?.key('Home')}>${t('surface.reset')}</button></p>
  </div>`;
}
