// SPDX-License-Identifier: Apache-2.0
import { html } from '../html.js';
import { PageHead } from '../parts/panel.js';
import { Link } from '../router.js';
import { useWords } from '../words.js';

export function Unknown() {
  const { t } = useWords();
  return html`<${PageHead} title=${t('page.unknown')} />
    <p>${t('unknown.text')} <${Link} to="/">${t('unknown.back')}<//></p>`;
}
