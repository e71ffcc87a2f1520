// SPDX-License-Identifier: Apache-2.0
// Judges whether the page may still be believed. slabd counts as silent if its last answer is older than kStale_ms. The
// age is that of the answer when the server made it, plus the time since the page sent the request, by performance.now().
// The browser's clock gives no age, because it may be wrong or may jump. It is only compared with performance.now(), which
// in some browsers stops while the computer is suspended: if it advanced much more, the page slept.

/// The page must be grey within 3 s. It looks every kLook_ms, and drawing takes some time too.
export const kStale_ms = 2500;
export const kLook_ms = 200;
/// Longest gap between two looks of a page that was awake, by either clock. After a longer one nothing is believed until an
/// answer comes.
export const kAsleep_ms = 5000;

/// What the page has heard. `now_ms`: performance.now(); `wall_ms`: Date.now(). Every function returns a new state.
export function heardNothing() {
  return { asked_ms: null, age_ms: null, looked_ms: null, wall_ms: null, distrust: false };
}

/// A usable status document came. `asked_ms`: performance.now() when the page sent the request; the server may have made
/// the document just after. `age_ms`: age of slabd's answer as the server states it; null: slabd never answered.
export function heard(state, asked_ms, age_ms) {
  const usable = typeof age_ms === 'number' && Number.isFinite(age_ms) && age_ms >= 0;
  return { ...state, asked_ms, age_ms: usable ? age_ms : null, distrust: false };
}

/// The page was hidden, suspended or restored from the browser's cache: what it shows may be from yesterday.
export function slept(state) {
  return { ...state, distrust: true };
}

/// True if there is a gap since the last look that only a sleeping page has.
export function hasSlept(state, now_ms, wall_ms) {
  if (state.looked_ms === null) return false;
  const passed_ms = now_ms - state.looked_ms;
  return passed_ms > kAsleep_ms || wall_ms - state.wall_ms - passed_ms > kAsleep_ms;
}

/// One look at the clocks.
export function looked(state, now_ms, wall_ms) {
  return { ...state, looked_ms: now_ms, wall_ms, distrust: state.distrust || hasSlept(state, now_ms, wall_ms) };
}

/// Age of slabd's last answer now, ms; null if there is none.
export function age(state, now_ms) {
  if (state.asked_ms === null || state.age_ms === null) return null;
  return state.age_ms + Math.max(0, now_ms - state.asked_ms);
}

export function isStale(state, now_ms) {
  const old = age(state, now_ms);
  return state.distrust || old === null || old > kStale_ms;
}
