// SPDX-License-Identifier: Apache-2.0
// Documents of the server. Every request has a time limit; an answer that is not the expected document is an error.
import { useEffect, useState } from 'preact/hooks';

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

/// {document, error, loading, again} of `path`; null as path: nothing is asked. While a new path loads, the previous
/// document stays with loading = true, so that filters do not make the page jump. `every_ms`: asks again and again.
/// `mark`: asks again when it changes.
export function useDocument(path, schema, every_ms = 0, mark = '') {
  const [state, setState] = useState({ path: null, document: null, error: null, loading: true });
  const [turn, setTurn] = useState(0);
  useEffect(() => {
    if (path === null) return undefined;
    const ending = new AbortController();
    let timer = 0;
    setState((before) => ({ ...before, loading: true }));
    document_of(path, schema, ending.signal)
      .then((document) => setState({ path, document, error: null, loading: false }))
      .catch((error) => {
        if (!ending.signal.aborted) setState({ path, document: null, error, loading: false });
      })
      .finally(() => {
        if (every_ms > 0 && !ending.signal.aborted) timer = setTimeout(() => setTurn((n) => n + 1), every_ms);
      });
    return () => {
      ending.abort();
      clearTimeout(timer);
    };
  }, [path, schema, turn, every_ms, mark]);
  return { ...state, again: () => setTurn((n) => n + 1) };
}
