// SPDX-License-Identifier: Apache-2.0
// Decisions of quality about a slab that did not pass: those that were recorded, and a form for the next one. Decisions are
// only added; the measured verdict stays.
import { useEffect, useRef, useState } from 'preact/hooks';
import { document_of, post } from '../api.js';
import { localTime } from '../figures.js';
import { html } from '../html.js';
import { Link, loginAddress } from '../router.js';
import { useSession } from '../session.js';
import { Foreign, visible } from '../text.js';
import { useWords } from '../words.js';
import { bytesOf, Field, kTextBytes, LongText, oneLine, Problem, Recorded } from './field.js';
import { Panel, Refusal } from './panel.js';
import { Facts } from './table.js';

export const kDecisions = ['hold', 'release_by_concession', 'rework', 'scrap', 're_inspect'];

/// The decisions that were recorded, next to the verdict. The last decision is in force.
export function Dispositions({ slab }) {
  const { t } = useWords();
  if (slab.dispositions.length === 0) return null;
  return html`<${Panel} title=${t('slab.dispositions')}><ol class="dispositions">${slab.dispositions.map((one, i) => html`<li key=${one.n}>
    <strong class=${i === slab.dispositions.length - 1 ? '' : 'quiet'}>${t(`disposition.${one.decision}`)}</strong> <time
      class="time">${localTime(one.utime)}</time>: <${Foreign} text=${one.reason} />
    <div class="quiet">${t('slab.decided_by')} <${Foreign} text=${[one.authority, one.second].filter(Boolean).join(', ')} />${' · '}
      ${t('slab.entered_by')} <${Foreign} text=${one.who} /></div></li>`)}</ol><//>`;
}

const kMissing = { reason: 'form.no_reason', authority: 'decision.no_authority', second: 'decision.no_second' };

/// The first field of a draft that cannot be recorded: {field, key of the text, bytes?}; null if there is none.
export function problemOf(draft, second_person) {
  const texts = ['reason', 'authority', ...(second_person ? ['second'] : [])];
  if (!kDecisions.includes(draft.decision)) return { field: 'decision', key: 'decision.no_decision' };
  for (const field of texts) {
    const bytes = bytesOf(draft[field].trim());
    if (bytes === 0) return { field, key: kMissing[field] };
    if (bytes > kTextBytes) return { field, key: 'form.too_long', bytes };
  }
  if (second_person && draft.second.trim() === draft.authority.trim()) return { field: 'second', key: 'decision.same_person' };
  return null;
}

/// The body of the request for a draft without problems.
export function bodyOf(draft, second_person) {
  const { decision } = draft;
  const body = { decision, reason: draft.reason.trim(), authority: draft.authority.trim() };
  return second_person ? { ...body, second: draft.second.trim() } : body;
}

/// True if the decisions `now` contain another one than the first `seen` of them and `body`. `body` itself may be there: the
/// answer to it was lost, and the server stores it only once.
export function isDecidedMeanwhile(now, seen, body) {
  const fields = ['decision', 'reason', 'authority', 'second'];
  const isOwn = (one) => fields.every((field) => one[field] === (body[field] ?? ''));
  return now.length !== seen && !(now.length === seen + 1 && isOwn(now.at(-1)));
}

/// Drafts by slab and user, so that a text is still there if the login expires while it is written. A logout deletes them.
const drafts = new Map();
export const forgetDrafts = () => drafts.clear();

/// Answers that may have been lost after the server had recorded the decision. To send it again is harmless.
const isUnclear = (error) => error.status === 0 || error.message === 'unusable';

function useDraft(slab, user) {
  const name = `${slab.key} ${user}`;
  const empty = { decision: '', reason: '', authority: user, second: '' };
  const [draft, setDraft] = useState(drafts.get(name) ?? empty);
  const set = (change) => {
    const next = { ...draft, ...change };
    drafts.set(name, next);
    setDraft(next);
  };
  const clear = () => {
    drafts.delete(name);
    setDraft(empty);
  };
  return [draft, set, clear];
}

function DecisionFields({ draft, set, problem, second_person, submit, form }) {
  const { t } = useWords();
  const text = (field, label) => html`<${Field} label=${label}><input type="text" name=${field} value=${draft[field]} autocomplete="off" required
    onInput=${(event) => set({ [field]: oneLine(event.target.value) })} /><//>`;
  return html`<form class="form" noValidate ref=${form} onSubmit=${submit} aria-label=${t('decision.title')}>
    <${Field} label=${t('slab.disposition')}><select name="decision" value=${draft.decision} required
        onChange=${(event) => set({ decision: event.target.value })}>
      <option value="">${t('decision.choose')}</option>
      ${kDecisions.map((name) => html`<option key=${name} value=${name}>${t(`disposition.${name}`)}</option>`)}
    </select><//>
    <${LongText} label=${t('field.reason')} name="reason" value=${draft.reason} set=${(reason) => set({ reason })} />
    ${text('authority', t('decision.authority'))}
    ${second_person && text('second', t('decision.second'))}
    <${Problem} text=${problem?.key ?? ''} bytes=${problem?.bytes} />
    <div class="buttons"><button type="submit">${t('decision.next')}</button></div>
  </form>`;
}

/// The second step: everything that will be recorded.
function Confirm({ slab, draft, second_person, busy, record, back, heading }) {
  const { t } = useWords();
  const body = bodyOf(draft, second_person);
  return html`<div class="form">
    <h3 tabindex="-1" ref=${heading}><${Foreign} text=${t('decision.confirm', { name: visible(slab.slab_id || slab.slab_no, 64) })} /></h3>
    <${Facts} facts=${[
      [t('slab.disposition'), html`<strong>${t(`disposition.${body.decision}`)}</strong>`],
      [t('field.reason'), html`<${Foreign} text=${body.reason} />`],
      [t('decision.authority'), html`<${Foreign} text=${body.authority} />`],
      second_person && [t('decision.second'), html`<${Foreign} text=${body.second} />`],
    ]} />
    <p class="quiet">${t('decision.final')}</p>
    <div class="buttons">
      <button type="button" aria-disabled=${String(busy)} onClick=${record}>${t('decision.record')}</button>
      <button type="button" aria-disabled=${String(busy)} onClick=${back}>${t('decision.back')}</button>
    </div>
  </div>`;
}

function NewDecision({ slab, session, again }) {
  const { t } = useWords();
  const { second_person } = session;
  const [draft, set, clear] = useDraft(slab, session.user ?? '');
  const [confirming, setConfirming] = useState(false);
  const [meanwhile, setMeanwhile] = useState(false);
  /// Number of decisions on the page when the user checked the form.
  const seen = useRef(0);
  const [problem, setProblem] = useState(null);
  const [error, setError] = useState(null);
  const [busy, setBusy] = useState(false);
  const [done, setDone] = useState('');
  const form = useRef(null);
  const heading = useRef(null);
  const first = useRef(true);
  useEffect(() => {
    // The control that had the focus is no longer there.
    if (first.current) first.current = false;
    else (confirming ? heading.current : form.current?.elements.decision)?.focus();
  }, [confirming]);
  const submit = (event) => {
    event.preventDefault();
    const found = problemOf(draft, second_person);
    setProblem(found);
    setDone('');
    setMeanwhile(false);
    seen.current = slab.dispositions.length;
    if (found === null) setConfirming(true);
    else form.current.elements[found.field].focus();
  };
  const back = () => {
    if (busy) return;
    setError(null);
    setConfirming(false);
  };
  const record = async () => {
    if (busy) return;
    setBusy(true);
    setError(null);
    const body = bodyOf(draft, second_person);
    try {
      const { dispositions } = await document_of(`/slabs/${slab.key}`, 'slabd.slab/1');
      if (isDecidedMeanwhile(dispositions, seen.current, body)) {
        setMeanwhile(true);
        setConfirming(false);
        again();
        return;
      }
      const answer = await post(`/slabs/${slab.key}/disposition`, body);
      setDone(answer.text);
      clear();
      setConfirming(false);
      again();
    } catch (refused) {
      setError(refused);
    } finally {
      setBusy(false);
    }
  };
  return html`<${Panel} title=${t('decision.title')}>
    <p class="quiet">${t('decision.stays')}</p>
    <${Recorded} text=${done} />
    ${meanwhile && html`<${Refusal} text=${t('decision.meanwhile')} />`}
    ${error && html`<${Refusal} error=${error} cure=${isUnclear(error) ? t('decision.once') : ''} />`}
    ${confirming
      ? html`<${Confirm} slab=${slab} draft=${draft} second_person=${second_person} busy=${busy} record=${record} back=${back} heading=${heading} />`
      : html`<${DecisionFields} draft=${draft} set=${set} problem=${problem} second_person=${second_person} submit=${submit} form=${form} />`}
  <//>`;
}

/// The form for a slab that ended and did not pass, or a link to the login. `again`: asks for the slab again.
export function DecisionPanel({ slab, again }) {
  const { t } = useWords();
  const { session } = useSession();
  if (session === null || !slab.ended || slab.verdict === 'pass') return null;
  if (session.may_write) return html`<${NewDecision} key=${session.user} slab=${slab} session=${session} again=${again} />`;
  if (session.role === 'quality' || !session.may_login) return null;
  return html`<p class="quiet">${t('decision.login')} <${Link} to=${loginAddress()}>${t('login.title')}<//></p>`;
}
