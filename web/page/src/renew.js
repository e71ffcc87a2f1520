// SPDX-License-Identifier: Apache-2.0
// A page that is open for weeks loads itself again every 6 h, so that it has the newest version and fresh memory. It does
// so only if it was not used for some minutes and the server answers; otherwise the browser would show its own error page.
import { useEffect } from 'preact/hooks';

const kAfter_ms = 6 * 3600 * 1000;
const kIdle_ms = 10 * 60 * 1000;
const kLook_ms = 60 * 1000;

export function useRenewal() {
  useEffect(() => {
    const loaded = performance.now();
    let used = loaded;
    const use = () => (used = performance.now());
    const events = ['pointerdown', 'keydown', 'wheel', 'touchstart'];
    for (const event of events) window.addEventListener(event, use, { passive: true });
    const timer = setInterval(async () => {
      const now = performance.now();
      if (now - loaded < kAfter_ms || now - used < kIdle_ms) return;
      try {
        const answer = await fetch('/healthz', { cache: 'no-store', signal: AbortSignal.timeout(2000) });
        if (answer.ok) location.reload();
      } catch {
        // The server does not answer: try again in a minute.
      }
    }, kLook_ms);
    return () => {
      clearInterval(timer);
      for (const event of events) window.removeEventListener(event, use);
    };
  }, []);
}
