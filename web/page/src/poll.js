// SPDX-License-Identifier: Apache-2.0
// Asks for slabd.web_status/1 once a second, and judges how old the answer is. One poll for all parts of the page. The
// next request begins after the previous one has ended, so a slow server never has two of this page.
import { age, hasSlept, heard, heardNothing, isStale, kLook_ms, looked, slept } from './stale.js';

/// From one request to the next. After a slow answer the next request begins sooner, after at least kPause_ms: an answer
/// is as old as its request, so that a longer pause would make the page grey between two good answers.
const kPeriod_ms = 1000;
const kPause_ms = 200;
const kTimeout_ms = 2000;

/// The server answers, but only after a login.
class LoginMissing extends Error {}

/// `world`: fetch, now (ms, monotonic), wall (ms, of the computer's clock), setTimeout, clearTimeout; tests replace them.
/// `language`: of the sentences.
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
  const sleepers = new Set();
  let shown = picture();

  function picture() {
    const old = age(state, world.now());
    return { status, stale, trouble, beats, age_ms: old };
  }
  function tell() {
    shown = picture();
    for (const listener of listeners) listener(shown);
  }

  /// Takes the answer to the request `ending`, which was sent at `asked_ms`; throws if it is not usable.
  async function take(answer, ending, asked_ms) {
    // Unchanged: slabd's answer is the one that the page has, and its age keeps counting.
    if (answer.status === 304 && status !== null) return;
    if (answer.status === 401) throw new LoginMissing();
    if (!answer.ok) throw new Error(`HTTP ${answer.status}`);
    const next = await answer.json();
    if (next?.schema !== 'slabd.web_status/1' || typeof next !== 'object') throw new Error('unusable');
    // After a sleep the answer may arrive before the next look.
    if (running && notice()) wake();
    if (!running || request !== ending) return;
    etag = answer.headers.get('ETag') ?? '';
    status = next;
    state = heard(state, asked_ms, next.status === null ? null : next.age_ms);
    trouble = typeof next.trouble === 'string' ? next.trouble : '';
    ++beats;
  }

  async function ask() {
    const ending = new AbortController();
    request = ending;
    const asked_ms = world.now();
    const limit = world.setTimeout(() => ending.abort(), kTimeout_ms);
    try {
      const headers = etag === '' ? {} : { 'If-None-Match': etag };
      const answer = await world.fetch(`/api/v1/status?language=${language}`, { signal: ending.signal, cache: 'no-store', headers });
      await take(answer, ending, asked_ms);
    } catch (error) {
      if (running && request === ending) trouble = error instanceof LoginMissing ? 'login' : 'server';
    } finally {
      world.clearTimeout(limit);
    }
    // Another request has taken its place.
    if (!running || request !== ending) return;
    request = null;
    judge();
    tell();
    timer = world.setTimeout(ask, Math.max(kPause_ms, kPeriod_ms - (world.now() - asked_ms)));
  }

  function judge() {
    stale = isStale(state, world.now());
  }
  /// Looks at the clocks; true if the page slept.
  function notice() {
    const [now_ms, wall_ms] = [world.now(), world.wall()];
    const asleep = hasSlept(state, now_ms, wall_ms);
    state = looked(state, now_ms, wall_ms);
    return asleep;
  }
  /// Nothing is believed until an answer comes to a request that is sent now. An answer to an earlier one may be as old as
  /// the sleep.
  function wake() {
    state = slept(state);
    judge();
    tell();
    request?.abort();
    request = null;
    hurry();
    for (const listener of sleepers) listener();
  }
  function look() {
    const before = stale;
    if (notice()) wake();
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
    /// Calls `listener` when the page was hidden or suspended. Returns a function that ends this.
    onWoke(listener) {
      sleepers.add(listener);
      return () => sleepers.delete(listener);
    },
    /// The page was hidden or suspended: nothing is believed until an answer comes, which is asked for at once.
    woke() {
      if (!running) return;
      notice();
      wake();
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
      sleepers.clear();
    },
  };
}
