// SPDX-License-Identifier: Apache-2.0
// Notes since when a link has its state. The status does not contain it, so it is counted from what this page saw: a state
// that was there when the page was opened began at least then.

/// {note(name, state, now_ms) -> {for_ms, atLeast}}
export function createSince() {
  const seen = new Map();
  return {
    note(name, state, now_ms) {
      const before = seen.get(name);
      if (before === undefined || before.state !== state)
        seen.set(name, { state, begun_ms: now_ms, atLeast: before === undefined });
      const entry = seen.get(name);
      return { for_ms: now_ms - entry.begun_ms, atLeast: entry.atLeast };
    },
  };
}
