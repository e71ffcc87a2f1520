// SPDX-License-Identifier: Apache-2.0
// Addresses of the pages. The server sends one shell for all of them; the page reads location.pathname.
import { useEffect, useState } from 'preact/hooks';
import { html } from './html.js';

/// At most the digits of a 64-bit key.
const kKey = '([1-9][0-9]{0,18})';
const kRoutes = [
  [/^\/$/, 'live', []],
  [/^\/slabs$/, 'slabs', []],
  [new RegExp(`^/slabs/${kKey}$`), 'slab', ['key']],
  [new RegExp(`^/slabs/${kKey}/blocks/([1-9]|1[0-8])$`), 'block', ['key', 'station']],
  [/^\/trends$/, 'trends', []],
  [/^\/trends\/([a-z_]{1,40})$/, 'trends', ['item']],
  [/^\/moulds$/, 'moulds', []],
  [/^\/plant$/, 'plant', []],
  [/^\/drafts$/, 'drafts', []],
  [/^\/drafts\/([A-Za-z0-9_][A-Za-z0-9._-]{0,63})$/, 'drafts', ['draft']],
  [/^\/calibration$/, 'calibration', []],
  [/^\/line$/, 'line', []],
  [/^\/compare$/, 'compare', []],
  [/^\/about$/, 'about', []],
  [/^\/login$/, 'login', []],
];

/// The page of an address: {page, key?, station?, query}. Unknown addresses are the page "unknown".
export function routeOf(pathname, search = '') {
  const path = pathname.length > 1 ? pathname.replace(/\/+$/, '') : pathname;
  const query = new URLSearchParams(search);
  for (const [pattern, page, names] of kRoutes) {
    const found = pattern.exec(path);
    if (found === null) continue;
    const route = { page, query };
    names.forEach((name, i) => (route[name] = name === 'station' ? Number(found[i + 1]) : found[i + 1]));
    return route;
  }
  return { page: 'unknown', query };
}

/// `path` with the parameters that are set, in a fixed order.
export function address(path, parameters = {}) {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(parameters))
    if (value !== '' && value !== null && value !== undefined) query.set(name, value);
  const text = query.toString();
  return text === '' ? path : `${path}?${text}`;
}

/// `to` if it is the address of a page other than the login, else the live page. `to` is part of a link that anyone can
/// send, so an address of another host must not be accepted.
export function ownAddress(to) {
  const text = String(to ?? '');
  if (!/^\/(?![/\\])/.test(text)) return '/';
  try {
    const host = 'http://page.invalid';
    const { origin, pathname, search } = new URL(text, host);
    const known = origin === host && !['unknown', 'login'].includes(routeOf(pathname).page);
    return known ? `${pathname}${search}` : '/';
  } catch {
    return '/';
  }
}

/// The address of the login, which returns to the page that is shown now.
export const loginAddress = () => address('/login', { to: `${location.pathname}${location.search}` });

const kMoved = 'slabd-moved';

/// Goes to an address of this page. `replace`: without a new entry in the history, as if the address is the one shown.
export function go(to, replace = false) {
  if (replace || to === `${location.pathname}${location.search}`) history.replaceState(null, '', to);
  else history.pushState(null, '', to);
  window.dispatchEvent(new Event(kMoved));
}

export function useRoute() {
  const now = () => routeOf(location.pathname, location.search);
  const [route, setRoute] = useState(now);
  useEffect(() => {
    const moved = () => setRoute(now());
    window.addEventListener('popstate', moved);
    window.addEventListener(kMoved, moved);
    return () => {
      window.removeEventListener('popstate', moved);
      window.removeEventListener(kMoved, moved);
    };
  }, []);
  return route;
}

/// A link inside the page. With a modifier key, or the middle button, the browser does what it always does.
export function Link({ to, children, ...rest }) {
  const clicked = (event) => {
    if (event.button !== 0 || event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) return;
    event.preventDefault();
    go(to);
  };
  return html`<a href=${to} onClick=${clicked} ...${rest}>${children}</a>`;
}
