// SPDX-License-Identifier: Apache-2.0
import { useEffect, useState } from 'preact/hooks';
import { html } from '../html.js';
import { PageHead, Panel } from '../parts/panel.js';
import { Facts } from '../parts/table.js';
import { Link } from '../router.js';
import { Foreign } from '../text.js';
import { useWords } from '../words.js';

/// Set by the build: version of the page and of its libraries.
const kVersions = __VERSIONS__;

export function About({ picture }) {
  const { t } = useWords();
  const [licences, setLicences] = useState('');
  useEffect(() => {
    const ending = new AbortController();
    fetch('/assets/licences.txt', { signal: ending.signal }).then((answer) => (answer.ok ? answer.text() : ''))
      .then(setLicences).catch(() => {});
    return () => ending.abort();
  }, []);
  const version = (value) => (value ? html`<${Foreign} text=${value} />` : t('link.unknown'));
  return html`
    <${PageHead} title=${t('about.title')} />
    <p>${t('about.text')}</p>
    <p><${Link} to="/drafts">${t('drafts.title')}<//>: ${t('about.drafts')}</p>
    <${Panel} title=${t('about.versions')}><${Facts} facts=${[
      [t('about.slabd'), version(picture.status?.status?.software)],
      [t('about.web'), version(picture.status?.slabd_web?.version)],
      ...Object.entries(kVersions),
    ]} /><//>
    <${Panel} title=${t('about.licences')}>
      <pre class="licences" tabindex="0" aria-label=${t('about.licences_text')}>${licences}</pre>
    <//>`;
}
