// SPDX-License-Identifier: Apache-2.0
// The surface in 3-D. Its program (three.js) is loaded only when somebody opens the view.
import { useEffect, useRef, useState } from 'preact/hooks';
import { html } from '../html.js';
import { useWords } from '../words.js';

const kProgram = '/assets/three.js';

export function SurfaceView({ map, end_mm, exaggeration, station, theme }) {
  const { t } = useWords();
  const host = useRef(null);
  const view = useRef(null);
  const [trouble, setTrouble] = useState('');
  const [ready, setReady] = useState(false);
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
    if (ready) view.current?.show(map, end_mm);
  }, [ready, map, end_mm]);
  useEffect(() => {
    if (ready) view.current?.look(exaggeration, theme);
  }, [ready, map, exaggeration, theme]);
  const pressed = (event) => {
    if (view.current?.key(event.key)) event.preventDefault();
  };
  if (trouble) return html`<p role="alert">${trouble}</p>`;
  return html`<div class="surface">
    <div class="surface-frame" ref=${host} tabindex="0" role="application" onKeyDown=${pressed} data-ready=${String(ready)}
      aria-label=${t('surface.label', { station, factor: exaggeration })}></div>
    <p class="quiet">${t('surface.hint')} <button type="button" onClick=${() => view.current?.key('Home')}>${t('surface.reset')}</button></p>
  </div>`;
}
