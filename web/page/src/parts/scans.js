// SPDX-License-Identifier: Apache-2.0
// Scans of a slab: how many of their files exist, and whether they are kept although space is needed (slabctl pin).
import { useEffect, useRef, useState } from 'preact/hooks';
import { post, useDocument, whileOpen } from '../api.js';
import { localTime } from '../figures.js';
import { html } from '../html.js';
import { useSession } from '../session.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';
import { bytesOf, kTextBytes, LongText, Problem, Recorded } from './field.js';
import { Panel, Refusal } from './panel.js';
import { Facts } from './table.js';

/// The key of the text about a reason that cannot be recorded; '' if it can.
export function reasonProblem(reason) {
  const bytes = bytesOf(reason.trim());
  return bytes === 0 ? 'form.no_reason' : bytes > kTextBytes ? 'form.too_long' : '';
}

function scanFacts(state, t) {
  const { pin } = state;
  return [
    [t('pin.files'), t('pin.there', { there: state.scans_there, all: state.scans })],
    [t('field.state'), pin ? html`<strong>${t('pin.kept')}</strong>` : t('pin.not_kept')],
    pin && [t('field.reason'), html`<${Foreign} text=${pin.reason} />`],
    pin && [t('field.since'), html`<time class="time">${localTime(pin.pinned)}</time>`],
  ];
}

function ScanState({ state, again }) {
  const { t } = useWords();
  const { session } = useSession();
  const [reason, setReason] = useState('');
  const [problem, setProblem] = useState('');
  const [error, setError] = useState(null);
  const [busy, setBusy] = useState(false);
  const [done, setDone] = useState('');
  const control = useRef(null);
  const pinned = useRef(state.pin !== null);
  useEffect(() => {
    // The button that had the focus was replaced.
    if (pinned.current === (state.pin !== null)) return;
    pinned.current = state.pin !== null;
    if (document.activeElement === document.body) control.current?.querySelector('button')?.focus();
  }, [state.pin]);
  const send = async (name, body) => {
    if (busy) return;
    setBusy(true);
    setError(null);
    setDone('');
    try {
      setDone((await post(`/slabs/${state.key}/${name}`, body)).text);
      setReason('');
      again();
    } catch (refused) {
      setError(refused);
    } finally {
      setBusy(false);
    }
  };
  const keep = (event) => {
    event.preventDefault();
    const found = reasonProblem(reason);
    setProblem(found);
    if (found === '') send('pin', { reason: reason.trim() });
    else event.target.elements.reason.focus();
  };
  const may_write = session?.may_write === true;
  return html`<${Panel} title=${t('pin.title')}>
    <${Facts} facts=${scanFacts(state, t)} />
    <${Recorded} text=${done} />
    ${error && html`<${Refusal} error=${error} />`}
    ${may_write && state.pin && html`<div class="buttons" ref=${control}>
      <button type="button" aria-disabled=${String(busy)} onClick=${() => send('unpin', {})}>${t('pin.unpin')}</button></div>`}
    ${may_write && !state.pin && state.scans_there > 0 && html`<form class="form" noValidate ref=${control} aria-label=${t('pin.keep')}
      onSubmit=${keep}>
      <${LongText} label=${t('pin.reason')} name="reason" value=${reason} set=${setReason} />
      <${Problem} text=${problem} bytes=${bytesOf(reason.trim())} />
      <div class="buttons"><button type="submit" aria-disabled=${String(busy)}>${t('pin.keep')}</button></div>
    </form>`}
  <//>`;
}

/// Nothing if the state cannot be read.
export function ScansPanel({ slab }) {
  const ask = useDocument(`/slabs/${slab.key}/pin`, 'slabd.pin_state/1', { every_ms: () => whileOpen(slab) });
  return ask.document && html`<${ScanState} state=${ask.document} again=${ask.again} />`;
}
