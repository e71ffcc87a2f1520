// SPDX-License-Identifier: Apache-2.0
// The part of the header that shows who is logged in, with a button to log out, or a link to the login.
import { useState } from 'preact/hooks';
import { html } from '../html.js';
import { Link, loginAddress } from '../router.js';
import { useSession } from '../session.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';
import { forgetDrafts } from './decision.js';

/// `linked`: with a link to the login if nobody is logged in.
export function Account({ linked }) {
  const { session, logout } = useSession();
  const { t } = useWords();
  const [failed, setFailed] = useState(false);
  if (session === null) return null;
  if (session.user === null)
    return session.may_login && linked ? html`<div class="account"><${Link} class="button" to=${loginAddress()}>${t('login.title')}<//></div>` : null;
  const leave = () => {
    setFailed(false);
    forgetDrafts();
    logout().catch(() => setFailed(true));
  };
  return html`<div class="account">
    <span class="account-name"><span class="for-readers">${t('login.as')} </span><${Foreign} text=${session.user} max=${64} /></span>
    <button type="button" onClick=${leave}>${t('login.out')}</button>
    ${failed && html`<span class="account-trouble" role="alert">${t('login.out_failed')}</span>`}
  </div>`;
}
