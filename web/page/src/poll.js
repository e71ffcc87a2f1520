// SPDX-License-Identifier: Apache-2.0
// Asks for slabd.web_status/1 once a second, and judges how old the answer is. One poll for all parts of the page. The
// next request begins after the previous one has ended, so a slow server never has two of this page.
import { age, heard, heardNothing, isStale, kLook_ms, looked, slept } from './stale.js';

const kPeriod_ms = 1000;
const kTimeout_ms = 2000;

/// The server answers, but only after a login.
class LoginMissing extends Error {}

/// `world`: fetch, now (ms, monotonic), setTimeout, clearTimeout; tests replace them. `language`: of the sentences.
export function createPoll(world, language = 'en') {
  let state = heardNothing();
  let status = null;
  let trouble = '';
  let beats = 0;
  let etag = '';
  let stale = true;
  let timer = 0;
  let look_timer = 0;
  let request = null;
  let running = false;
  const listeners = new Set();
  let shown = picture();

  function picture() {
    const old = age(state, world.now());
    return { status, stale, trouble, beats, age_ms: old };
  }
  function tell() {
    shown = picture();
    for (const listener of listeners) listener(shown);
  }

  /// Takes an answer; throws if it is not usable.
  async function take(answer) {
    // Unchanged: slabd's answer is the one that the page has, and its age keeps counting.
    if (answer.status === 304 && status !== null) return;
    if (answer.status === 401) throw new LoginMissing();
    if (!answer.ok) throw new Error(`HTTP ${answer.status}`);
    const next = await answer.json();
    if (next?.schema !== 'slabd.web_status/1' || typeof next !== 'object') throw new Error('unusable');
    etag = answer.headers.get('ETag') ?? '';
    status = next;
    state = heard(state, world.now(), next.status === null ? null : next.age_ms);
    trouble = typeof next.trouble === 'string' ? next.trouble : '';
    ++beats;
  }

  async function ask() {
    const ending = new AbortController();
    request = ending;
    const limit = world.setTimeout(() => ending.abort(), kTimeout_ms);
    try {
      const headers = etag === '' ? {} : { 'If-None-Match': etag };
      await take(await world.fetch(`/api/v1/status?language=${language}`, { signal: ending.signal, cache: 'no-store', headers }));
    } catch (error) {
      if (running) trouble = error instanceof LoginMissing ? 'login' : 'server';
    } finally {
      world.clearTimeout(limit);
      if (request === ending) request = null;
    }
    if (!running || ending !== (request ?? ending)) return;
    judge();
    tell();
    timer = world.setTimeout(ask, kPeriod_ms);
  }

  function judge() {
    stale = isStale(state, world.now());
  }
  function look() {
    const before = stale;
    state = looked(state, world.now());
    judge();
    // A stale page shows its age in seconds.
    if (stale !== before || (stale && Math.floor((shown.age_ms ?? 0) / 1000) !== Math.floor((picture().age_ms ?? 0) / 1000)))
      tell();
    look_timer = world.setTimeout(look, kLook_ms);
  }

  /// Asks at once if no request is running.
  function hurry() {
    if (request !== null) return;
    world.clearTimeout(timer);
    ask();
  }

  return {
    picture: () => shown,
    listen(listener) {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    start() {
      if (running) return;
      running = true;
      ask();
      look();
    },
    /// The page was hidden or suspended: nothing is believed until an answer comes, which is asked for at once.
    woke() {
      if (!running) return;
      state = slept(state);
      judge();
      tell();
      hurry();
    },
    /// The sentences come in another language from the next answer on.
    setLanguage(next) {
      if (next === language) return;
      language = next;
      etag = '';
      if (running) hurry();
    },
    stop() {
      running = false;
      world.clearTimeout(timer);
      world.clearTimeout(look_timer);
      request?.abort();
      listeners.clear();
    },
  };
}
