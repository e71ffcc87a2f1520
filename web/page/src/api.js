// SPDX-License-Identifier: Apache-2.0
// Documents of the server. Every request has a time limit; an answer that is not the expected document is an error.
import { useEffect, useRef, useState } from 'preact/hooks';

/// slabctl makes most documents within 0.2 s; a report or a busy computer takes longer.
const kTimeout_ms = 20000;
export const kApi = '/api/v1';

/// Error of a request: the server's own text and cure if it sent them.
/// `retry_after_s`: seconds until the server accepts the next try; null if it did not say.
export class ApiError extends Error {
  constructor(status, text, cure = '', retry_after_s = null) {
    super(text);
    this.status = status;
    this.cure = cure;
    this.retry_after_s = retry_after_s;
  }
}

/// Language of the server's errors; '' until the page has one.
let language = '';
export const answerIn = (next) => (language = next);

const refused = new Set();

/// Calls `listener` if an answer is 401: a login is missing or has expired. Returns a function that ends this.
export function onRefused(listener) {
  refused.add(listener);
  return () => refused.delete(listener);
}

const sleepers = new Set();

/// Calls `listener` when the page was hidden or suspended, so that its documents may be old. Returns a function that ends
/// this.
export function onWoke(listener) {
  sleepers.add(listener);
  return () => sleepers.delete(listener);
}
/// The page was hidden or suspended.
export function woke() {
  for (const listener of sleepers) listener();
}

/// Seconds of the header Retry-After; null if it is missing or a date.
export function retryAfter(text) {
  return /^\d{1,6}$/.test(text ?? '') ? Number(text) : null;
}

/// The answer to a request, which must have the schema `schema`. `signal` ends the request early.
async function request(path, options, schema, signal) {
  const limit = AbortSignal.timeout(kTimeout_ms);
  const both = signal ? AbortSignal.any([signal, limit]) : limit;
  let answer;
  try {
    const headers = { ...options.headers, ...(language && { 'Accept-Language': language }) };
    answer = await fetch(`${kApi}${path}`, { ...options, headers, signal: both, credentials: 'same-origin' });
  } catch (error) {
    if (signal?.aborted) throw error;
    throw new ApiError(0, limit.aborted ? 'timeout' : 'unreachable');
  }
  let body = null;
  try {
    body = await answer.json();
  } catch (error) {
    if (signal?.aborted) throw error;
  }
  if (answer.status === 401) for (const listener of refused) listener();
  if (!answer.ok) throw new ApiError(answer.status, body?.text ?? '', body?.cure ?? '', retryAfter(answer.headers.get('Retry-After')));
  if (body?.schema !== schema) throw new ApiError(answer.status, 'unusable');
  return body;
}

/// The document at `path`.
export const document_of = (path, schema, signal) => request(path, { cache: 'no-cache' }, schema, signal);

/// Sends `body` as JSON to `path`; the answer must have the schema `schema`.
export const post = (path, body, schema = 'slabd.web_done/1') =>
  request(path, { method: 'POST', cache: 'no-store', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body) }, schema);

/// Period of renewing a document of a slab that has not ended: its verdicts are provisional. Also the time until the next
/// try of a request that failed.
export const kOpen_ms = 5000;
/// `every_ms` of the documents of a slabd.slab/1.
export const whileOpen = (slab) => (slab.ended ? 0 : kOpen_ms);

/// True if the same request may succeed later: no answer came, or the server is busy. A document that takes too long, or is
/// too large, will be so again.
const mayPass = (error) => error !== null && (error.status === 0 || error.status === 503);

/// Calls ask(signal) for a document and show({document, error}) with the answer. `every_ms(document)`: milliseconds until the
/// document is renewed; 0: never. A renewal without news shows nothing. A renewal that fails keeps the document. After a
/// failure that may pass, the next request follows in any case. Returns {again, end}: again() renews at once, and an answer
/// to an earlier request is not used. `world`: setTimeout, clearTimeout; tests replace them.
export function follow(ask, every_ms, show, world = globalThis) {
  let request = null;
  let timer = 0;
  let kept = null;
  let text = '';
  const again = async () => {
    const ending = new AbortController();
    request?.abort();
    request = ending;
    world.clearTimeout(timer);
    let failure = null;
    try {
      const document = await ask(ending.signal);
      if (ending.signal.aborted) return;
      const now = JSON.stringify(document);
      if (now !== text) {
        kept = document;
        text = now;
        show({ document, error: null });
      }
    } catch (error) {
      if (ending.signal.aborted) return;
      failure = error;
      if (kept === null) show({ document: null, error });
    }
    const usual_ms = kept === null ? 0 : every_ms(kept);
    const wait_ms = usual_ms > 0 || !mayPass(failure) ? usual_ms : kOpen_ms;
    if (wait_ms > 0) timer = world.setTimeout(again, wait_ms);
  };
  again();
  const end = () => {
    request.abort();
    world.clearTimeout(timer);
  };
  return { again, end };
}

const never = () => 0;

/// {document, error, loading, again} of `path`; null as path: nothing is asked. While a new path loads, the previous
/// document stays with loading = true, so that filters do not make the page jump. `mark`: asks again when it changes.
/// `every_ms(document)`: as of follow. `news`: renews the document when it changes. So does a page that was hidden or
/// suspended. A renewal is not shown as loading.
export function useDocument(path, schema, { every_ms = never, mark = '', news = '' } = {}) {
  const [state, setState] = useState({ path: null, document: null, error: null, loading: true });
  const [turn, setTurn] = useState(0);
  const every = useRef(every_ms);
  every.current = every_ms;
  const following = useRef(null);
  const known = useRef(news);
  useEffect(() => {
    if (path === null) return undefined;
    setState((before) => ({ ...before, loading: true }));
    following.current = follow((signal) => document_of(path, schema, signal), (document) => every.current(document),
      (answer) => setState({ path, ...answer, loading: false }));
    return () => {
      following.current.end();
      following.current = null;
    };
  }, [path, schema, turn, mark]);
  useEffect(() => onWoke(() => following.current?.again()), []);
  useEffect(() => {
    if (known.current === news) return;
    known.current = news;
    following.current?.again();
  }, [news]);
  return { ...state, again: () => setTurn((n) => n + 1) };
}
