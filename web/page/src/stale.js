// SPDX-License-Identifier: Apache-2.0
// Judges whether the page may still be believed. slabd counts as silent if its last answer is older than kStale_ms. The
// age is that of the answer when the server sent it, plus the time since then by performance.now(): the browser's clock
// is not used, because it may be wrong or may jump.

/// The page must be grey within 3 s. It looks every kLook_ms, and drawing takes some time too.
export const kStale_ms = 2500;
export const kLook_ms = 200;
/// Longest gap between two looks of a page that was awake. After a longer one nothing is believed until an answer comes.
export const kAsleep_ms = 5000;

/// What the page has heard. `now_ms`: performance.now(). Every function returns a new state.
export function heardNothing() {
  return { received_ms: null, age_ms: null, looked_ms: null, distrust: false };
}

/// A usable status document came. `age_ms`: age of slabd's answer as the server states it; null: slabd never answered.
export function heard(state, now_ms, age_ms) {
  const usable = typeof age_ms === 'number' && Number.isFinite(age_ms) && age_ms >= 0;
  return { ...state, received_ms: now_ms, age_ms: usable ? age_ms : null, looked_ms: now_ms, distrust: false };
}

/// The page was hidden, suspended or restored from the browser's cache: what it shows may be from yesterday.
export function slept(state) {
  return { ...state, distrust: true };
}

/// One look at the clock: notes a gap that only a sleeping page has.
export function looked(state, now_ms) {
  const asleep = state.looked_ms !== null && now_ms - state.looked_ms > kAsleep_ms;
  return { ...state, looked_ms: now_ms, distrust: state.distrust || asleep };
}

/// Age of slabd's last answer now, ms; null if there is none.
export function age(state, now_ms) {
  if (state.received_ms === null || state.age_ms === null) return null;
  return state.age_ms + Math.max(0, now_ms - state.received_ms);
}

export function isStale(state, now_ms) {
  const old = age(state, now_ms);
  return state.distrust || old === null || old > kStale_ms;
}
