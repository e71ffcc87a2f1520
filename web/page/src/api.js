// SPDX-License-Identifier: Apache-2.0
// Documents of the server. Every request has a time limit; an answer that is not the expected document is an error.
import { useEffect, useState } from 'preact/hooks';

/// slabctl makes most documents within 0.2 s; a report or a busy computer takes longer.
const kTimeout_ms = 20000;
export const kApi = '/api/v1';

/// Error of a request: the server's own text and cure if it sent them.
export class ApiError extends Error {
  constructor(status, text, cure = '') {
    super(text);
    this.status = status;
    this.cure = cure;
  }
}

/// The document at `path`, which must have the schema `schema`. `signal` ends the request early.
export async function document_of(path, schema, signal) {
  const limit = AbortSignal.timeout(kTimeout_ms);
  const both = signal ? AbortSignal.any([signal, limit]) : limit;
  let answer;
  try {
    answer = await fetch(`${kApi}${path}`, { signal: both, cache: 'no-cache', credentials: 'same-origin' });
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
  if (!answer.ok) throw new ApiError(answer.status, body?.text ?? '', body?.cure ?? '');
  if (body?.schema !== schema) throw new ApiError(answer.status, 'unusable');
  return body;
}

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
