// SPDX-License-Identifier: Apache-2.0
import { render } from 'preact';
import { html } from './html.js';
import { answerIn, woke } from './api.js';
import { createPoll } from './poll.js';
import { App } from './app.js';
import { session, startSession } from './session.js';
import { languageOf, stored } from './settings.js';

const language = languageOf(new URLSearchParams(location.search).get('lang'), stored('language'), navigator.languages);
answerIn(language);
const poll = createPoll({
  fetch: (...request) => fetch(...request),
  now: () => performance.now(),
  wall: () => Date.now(),
  setTimeout: (...call) => setTimeout(...call),
  clearTimeout: (timer) => clearTimeout(timer),
}, language);

// A page that was hidden or came back from the browser's cache believes nothing until an answer comes.
document.addEventListener('visibilitychange', () => {
  if (document.visibilityState !== 'visible') return;
  poll.woke();
  session.again();
});
window.addEventListener('pageshow', (event) => {
  if (event.persisted) poll.woke();
});
// The browser slows a hidden page down as if it slept; its documents are renewed when it is shown again.
poll.onWoke(() => {
  if (document.visibilityState === 'visible') woke();
});

poll.start();
startSession(poll);
render(html`<${App} poll=${poll} firstLanguage=${language} />`, document.getElementById('app'));
