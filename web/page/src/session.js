// SPDX-License-Identifier: Apache-2.0
// Who is logged in, from slabd.web_session/1. The cookie of the login cannot be read by the page, so the server is asked:
// at the start, once a minute, after an answer 401, and after every login and logout.
import { useEffect, useState } from 'preact/hooks';
import { ApiError, document_of, onRefused, post } from './api.js';

const kPeriod_ms = 60_000;
/// Until the next try if the server did not answer.
const kRetry_ms = 10_000;
const kSchema = 'slabd.web_session/1';

/// `world`: ask() and post(path, body) of slabd.web_session/1, setTimeout, clearTimeout; tests replace them.
export function createSession(world) {
  let state = { session: null, error: null };
  let timer = 0;
  let asking = null;
  /// Number of logins and logouts. An answer to a question from before the newest one is outdated.
  let turn = 0;
  const listeners = new Set();

  function take(next) {
    state = next;
    for (const listener of listeners) listener(state);
  }

  async function ask(mine) {
    let failed = false;
    try {
      const session = await world.ask();
      if (mine === turn) take({ session, error: null });
    } catch (error) {
      failed = true;
      if (mine === turn) take({ ...state, error });
    } finally {
      asking = null;
      world.clearTimeout(timer);
      timer = world.setTimeout(again, failed ? kRetry_ms : kPeriod_ms);
    }
  }
  /// Asks the server. One request at a time.
  function again() {
    asking ??= ask(turn);
    return asking;
  }

  async function send(path, body) {
    ++turn;
    const session = await world.post(path, body);
    ++turn;
    return session;
  }
  async function logout() {
    take({ session: await send('/logout', {}), error: null });
  }
  /// The answer to a login has the user; the answer to the next question only if the browser sends the cookie back.
  async function login(name, password) {
    const sent = await send('/login', { name, password });
    const mine = turn;
    let session = sent;
    try {
      session = await world.ask();
    } catch {
      // The server does not answer this time; it is asked again in a minute.
    }
    if (mine !== turn) return;
    take({ session, error: null });
    if (session.user !== sent.user) throw new ApiError(0, 'cookie');
  }

  return {
    state: () => state,
    listen(listener) {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    again,
    /// Throws ApiError if the server refuses, or with the text "cookie" if the browser does not keep the login.
    login,
    logout,
    /// A document was answered, or refused because a login is missing (`missing`). Asks if the page expected otherwise.
    heard(missing) {
      if (missing !== (state.session?.login_required === true)) again();
    },
  };
}

export const session = createSession({
  ask: () => document_of('/session', kSchema),
  post: (path, body) => post(path, body, kSchema),
  setTimeout: (...call) => setTimeout(...call),
  clearTimeout: (timer) => clearTimeout(timer),
});

/// Keeps the session and the poll in step: asks when one of them finds that a login is missing or was made.
export function startSession(poll) {
  onRefused(() => session.heard(true));
  poll.listen((picture) => {
    if (picture.trouble === 'login') session.heard(true);
    else if (!picture.stale) session.heard(false);
  });
  let user = null;
  session.listen((state) => {
    const next = state.session?.user ?? null;
    if (next !== user && poll.picture().trouble === 'login') poll.woke();
    user = next;
  });
  session.again();
}

/// {session (null: not known yet), error, login, logout, again}.
export function useSession() {
  const [state, setState] = useState(session.state());
  useEffect(() => {
    setState(session.state());
    return session.listen(setState);
  }, []);
  return { ...state, login: session.login, logout: session.logout, again: session.again };
}
