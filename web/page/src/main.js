// SPDX-License-Identifier: Apache-2.0
import { render } from 'preact';
import { html } from './html.js';
import { createPoll } from './poll.js';
import { App } from './app.js';
import { session, startSession } from './session.js';

const poll = createPoll({
  fetch: (...request) => fetch(...request),
  now: () => performance.now(),
  setTimeout: (...call) => setTimeout(...call),
  clearTimeout: (timer) => clearTimeout(timer),
});

// A page that was hidden or came back from the browser's cache believes nothing until an answer comes.
document.addEventListener('visibilitychange', () => {
  if (document.visibilityState !== 'visible') return;
  poll.woke();
  session.again();
});
window.addEventListener('pageshow', (event) => {
  if (event.persisted) poll.woke();
});

poll.start();
startSession(poll);
render(html`<${App} poll=${poll} />`, document.getElementById('app'));
