// SPDX-License-Identifier: Apache-2.0
import { useEffect, useRef } from 'preact/hooks';
import { html } from '../html.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';

let count = 0;

/// A section with a heading.
export function Panel({ title, children, className = '', aside = null }) {
  const id = useRef(`panel-${++count}`).current;
  return html`<section class=${`panel ${className}`} aria-labelledby=${id}>
    <div class="panel-head"><h2 id=${id}>${title}</h2>${aside}</div>
    ${children}
  </section>`;
}

/// Sets the title of the window, and the main heading of the page. `children`: next to the heading.
export function PageHead({ title, children }) {
  const { t, language } = useWords();
  useEffect(() => {
    document.title = `${title} · ${t('app.title')}`;
  }, [title, language]);
  return html`<div class="page-head"><h1 tabindex="-1">${title}</h1>${children}</div>`;
}

/// Why a request failed: the server's text, or that of the page if no usable answer came.
function Why({ error }) {
  const { t } = useWords();
  const plain = ['unreachable', 'timeout', 'unusable'].includes(error.message);
  if (plain) return t(`error.${error.message}`);
  return error.message ? html`<${Foreign} text=${error.message} />` : t('error.http', { status: error.status ?? '' });
}

/// Why an input was not accepted. `text`, `cure`: shown instead of the server's.
export function Refusal({ error, text = '', cure = '' }) {
  const advice = text === '' ? cure || error.cure : cure;
  return html`<div class="trouble" role="alert">
    <p>${text || html`<${Why} error=${error} />`}</p>
    ${advice && html`<p>→ <${Foreign} text=${advice} /></p>`}
  </div>`;
}

/// Why a document is not there, with a button that asks again.
export function Trouble({ error, again }) {
  const { t } = useWords();
  return html`<div class="trouble" role="alert">
    <p><strong>${t('error.title')}</strong></p>
    <p><${Why} error=${error} /></p>
    ${error.cure && html`<p>→ <${Foreign} text=${error.cure} /></p>`}
    ${again && html`<button type="button" onClick=${again}>${t('app.again')}</button>`}
  </div>`;
}

/// The document of `ask` (useDocument) drawn by `children`, or that it loads, or why it is not there.
export function Loaded({ ask, children }) {
  const { t } = useWords();
  if (ask.error) return html`<${Trouble} error=${ask.error} again=${ask.again} />`;
  if (!ask.document) return html`<p class="quiet" aria-busy="true">${t('app.loading')} …</p>`;
  return html`<div class=${`stack${ask.loading ? ' loading' : ''}`}>${children(ask.document)}</div>`;
}
