// SPDX-License-Identifier: Apache-2.0
// The login. It is the page /login, and is shown in place of another page if nothing can be read without a login.
import { useState } from 'preact/hooks';
import { html } from '../html.js';
import { Field } from '../parts/field.js';
import { Loaded, PageHead, Refusal } from '../parts/panel.js';
import { go, ownAddress } from '../router.js';
import { useSession } from '../session.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';

/// What the page says about a refused login, or '' if the server's own text is shown.
export function refusalOf(error, t) {
  if (error.message === 'cookie') return t('login.cookie');
  if (error.status === 401) return t('login.wrong');
  if (error.status === 429 && error.retry_after_s !== null) return t('login.wait', { seconds: error.retry_after_s });
  return '';
}

/// The fields are read when the form is sent, because a password manager may fill them without an event.
function LoginForm({ after }) {
  const { t } = useWords();
  const { login } = useSession();
  const [busy, setBusy] = useState(false);
  const [error, setError] = useState(null);
  const submit = async (event) => {
    event.preventDefault();
    if (busy) return;
    const { name, password } = event.target.elements;
    const empty = name.value.trim() === '' ? name : password.value === '' ? password : null;
    if (empty !== null) {
      setError(empty.name);
      empty.focus();
      return;
    }
    setBusy(true);
    setError(null);
    try {
      await login(name.value.trim(), password.value);
      after();
    } catch (refused) {
      setError(refused);
      setBusy(false);
      password.value = '';
      password.focus();
    }
  };
  const text = error === 'name' ? t('login.no_name') : error === 'password' ? t('login.no_password') : error && refusalOf(error, t);
  return html`<form class="panel form form-narrow" method="post" noValidate aria-label=${t('login.title')} onSubmit=${submit}>
    <${Field} label=${t('login.name')}><input type="text" name="name" autocomplete="username" autocapitalize="none" spellcheck=${false}
      required /><//>
    <${Field} label=${t('login.password')}><input type="password" name="password" autocomplete="current-password" required /><//>
    ${error && html`<${Refusal} error=${error} text=${text} />`}
    <div class="buttons"><button type="submit" aria-disabled=${String(busy)}>${t('login.title')}</button></div>
  </form>`;
}

export function Login({ route }) {
  const { t } = useWords();
  const { session, error, again } = useSession();
  const role = session?.role === 'quality' ? 'role.quality' : 'role.viewer';
  const after = () => {
    if (route.page === 'login') go(ownAddress(route.query.get('to')), true);
  };
  return html`
    <${PageHead} title=${t('login.title')} />
    ${session?.login_required && html`<p>${t('login.required')}</p>`}
    ${session?.user && html`<p>${t('login.as')} <${Foreign} text=${session.user} max=${64} /> (${t(role)})</p>`}
    ${session === null ? html`<${Loaded} ask=${{ document: null, error, again }} />`
      : session.may_login ? html`<${LoginForm} after=${after} />`
      : html`<p role="alert">${t('login.not_possible')}</p>`}`;
}
